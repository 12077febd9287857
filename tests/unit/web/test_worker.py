from __future__ import annotations

import asyncio
import os
from collections.abc import Iterator

import pytest

from benchtool.errors import BenchtoolError, RunStopped
from benchtool.web.worker import Worker


@pytest.fixture
def worker() -> Iterator[Worker]:
    made = Worker("sums")
    yield made
    made.close()


def test_jobs_follow_each_other_in_one_process_of_their_own(worker: Worker) -> None:
    async def ask() -> list[int]:
        return [await worker.run(os.getpid) for _ in range(2)]

    first, second = asyncio.run(ask())
    assert first == second != os.getpid()


def test_a_fault_is_one_sentence_and_the_process_goes_on(
    worker: Worker, capfd: pytest.CaptureFixture[str]
) -> None:
    async def ask() -> int:
        with pytest.raises(BenchtoolError, match=r"a fault in benchtool itself, ValueError: .*'x'"):
            await worker.run(int, "x")
        found: int = await worker.run(int, "7")
        return found

    assert asyncio.run(ask()) == 7
    assert "Traceback" in capfd.readouterr().err


def test_a_process_that_ends_is_told_and_replaced(worker: Worker) -> None:
    async def ask() -> int:
        with pytest.raises(RunStopped, match="the process for sums ended before it was done"):
            await worker.run(os._exit, 3)
        found: int = await worker.run(int, "7")
        return found

    assert asyncio.run(ask()) == 7
