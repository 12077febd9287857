from __future__ import annotations

import asyncio
import os
from pathlib import Path

import pytest

from benchtool.core.errors import BenchtoolError, InputError, RunInterrupted
from benchtool.data.atomic import partial_folder
from benchtool.tasks import Job
from benchtool.web.command_jobs import CommandJob
from benchtool.web.context import ServerState
from tests.unit.web import job_functions

LONG_S = 60.0
OUT = Path("out")


@pytest.fixture
def server(tmp_path):
    server = ServerState(runs=tmp_path)
    yield server
    server.close()


def test_short_work_follows_each_other_and_an_error_of_ours_is_its_sentence(server, capfd):
    async def run() -> list[int]:
        pids = [await server.run("sums", os.getpid) for _ in range(2)]
        with pytest.raises(BenchtoolError, match=r"internal error of benchtool, ValueError: .*'x'"):
            await server.run("sums", int, "x")
        return [*pids, await server.run("sums", int, "7")]

    first, second, seven = asyncio.run(run())
    assert first == second != os.getpid()
    assert seven == 7
    assert "Traceback" in capfd.readouterr().err


def test_a_worker_that_ends_is_reported_and_replaced(server):
    async def run() -> int:
        with pytest.raises(RunInterrupted, match="the process for sums ended unexpectedly"):
            await server.run("sums", os._exit, 3)
        number: int = await server.run("sums", int, "7")
        return number

    assert asyncio.run(run()) == 7


def test_a_worker_ends_at_once_when_it_is_closed(server):
    async def run() -> None:
        await server.run("sums", os.getpid)
        lingering = asyncio.ensure_future(server.run("sums", job_functions.linger))
        await asyncio.sleep(0)
        server.close()
        with pytest.raises((RunInterrupted, asyncio.CancelledError)):
            await asyncio.wait_for(lingering, LONG_S)

    asyncio.run(run())


def test_a_result_comes_back_with_the_stages_in_order():
    job = CommandJob(OUT, ["add"], job_functions.add, 2, 3)
    assert (job.result(LONG_S), job.share) == (5, 1.0)
    assert job.succeeded
    assert job.stages == ("adding", "done")


@pytest.mark.parametrize(
    ("function", "daemon", "error"),
    [
        (job_functions.refuse, True, "unknown rig 'quat'; did you mean 'quad'? known: quad"),
        (job_functions.stumble, True, "internal error of benchtool, ZeroDivisionError"),
        (job_functions.fall, True, "exit code 9"),
        (job_functions.fall, False, "exit code 9"),
    ],
    ids=["ours", "fault", "death", "death of a process that outlives this one"],
)
def test_what_fails_says_why(function, daemon, error):
    job = Job(function, daemon=daemon)
    assert error in str(job.exception(LONG_S))
    assert not job.succeeded


def test_one_job_of_a_kind_runs_and_cancel_deletes_what_it_wrote(server, tmp_path):
    out = tmp_path / "fit"
    job = server.start_job("fits", lambda: CommandJob(out, (), job_functions.linger))
    with pytest.raises(InputError, match=r"fit is still running .*wait or cancel it"):
        server.start_job("fits", lambda: CommandJob(out, (), job_functions.linger))
    partial_folder(out).mkdir()
    job.cancel()
    assert job.cancelled()
    assert list(tmp_path.iterdir()) == []
    # A leftover partial folder is deleted by the next job and by the end of the server.
    for end in (lambda: server.start_job("fits", lambda: job), server.close):
        partial_folder(out).mkdir()
        end()
        assert list(tmp_path.iterdir()) == []
