from __future__ import annotations

import asyncio
import os
from pathlib import Path

import pytest

from benchtool.core.errors import BenchtoolError, InputError, RunInterrupted
from benchtool.data.atomic import partial_folder
from benchtool.web.context import ServerState
from benchtool.web.jobs import Job, WorkerProcess
from tests.unit.web import job_functions

LONG_S = 60.0
OUT = Path("out")


@pytest.fixture
def worker():
    process = WorkerProcess("sums")
    yield process
    process.close()


def test_short_work_follows_each_other_and_an_error_of_ours_is_its_sentence(worker, capfd):
    async def run() -> list[int]:
        pids = [await worker.run(os.getpid) for _ in range(2)]
        with pytest.raises(BenchtoolError, match=r"internal error of benchtool, ValueError: .*'x'"):
            await worker.run(int, "x")
        return [*pids, await worker.run(int, "7")]

    first, second, seven = asyncio.run(run())
    assert first == second != os.getpid()
    assert seven == 7
    assert "Traceback" in capfd.readouterr().err


def test_a_worker_that_ends_is_reported_and_replaced(worker):
    async def run() -> int:
        with pytest.raises(RunInterrupted, match="the process for sums ended unexpectedly"):
            await worker.run(os._exit, 3)
        number: int = await worker.run(int, "7")
        return number

    assert asyncio.run(run()) == 7


def test_a_worker_ends_at_once_when_it_is_closed(worker):
    async def run() -> None:
        await worker.run(os.getpid)
        lingering = asyncio.ensure_future(worker.run(job_functions.linger))
        await asyncio.sleep(0)
        worker.close()
        with pytest.raises((RunInterrupted, asyncio.CancelledError)):
            await asyncio.wait_for(lingering, LONG_S)

    asyncio.run(run())


def test_a_result_comes_back_with_the_stages_in_order():
    state = Job(OUT, ["add"], job_functions.add, 2, 3).wait(LONG_S)
    assert (state.status, state.result, state.share) == ("done", 5, 1.0)
    assert state.stages == ("adding", "done")


@pytest.mark.parametrize(
    ("function", "error"),
    [
        (job_functions.refuse, "unknown rig 'quat'; did you mean 'quad'? known: quad"),
        (job_functions.stumble, "internal error of benchtool, ZeroDivisionError"),
        (job_functions.fall, "exit code 9"),
    ],
    ids=["ours", "fault", "death"],
)
def test_what_fails_says_why(function, error):
    state = Job(OUT, (), function).wait(LONG_S)
    assert state.status == "failed"
    assert error in state.error


def test_one_job_of_a_kind_runs_and_cancel_deletes_what_it_wrote(tmp_path):
    out = tmp_path / "fit"
    server = ServerState(runs=tmp_path)
    job = server.start_job("fits", lambda: Job(out, (), job_functions.linger))
    with pytest.raises(InputError, match=r"fit is still running .*wait or cancel it"):
        server.start_job("fits", lambda: Job(out, (), job_functions.linger))
    partial_folder(out).mkdir()
    job.cancel()
    assert job.wait(LONG_S).status == "cancelled"
    assert list(tmp_path.iterdir()) == []
    # A leftover partial folder is deleted by the next job and by the end of the server.
    for end in (lambda: server.start_job("fits", lambda: job), server.close):
        partial_folder(out).mkdir()
        end()
        assert list(tmp_path.iterdir()) == []
