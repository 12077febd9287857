from __future__ import annotations

import os
import sys

import pytest

from benchtool.web.job import NICENESS, Job
from tests.unit.web import job_works

LONG_S = 60.0


def test_a_result_comes_back_with_the_stages_in_order() -> None:
    state = Job(job_works.add, 2, 3).wait(LONG_S)
    assert (state.status, state.result, state.share) == ("done", 5, 1.0)
    assert state.stages == ("adding", "done")


def test_an_error_of_ours_is_its_sentence() -> None:
    state = Job(job_works.refuse).wait(LONG_S)
    assert state.status == "failed"
    assert state.error == "unknown rig 'quat'; did you mean 'quad'? known: quad"


def test_a_fault_says_that_it_is_one(capfd: pytest.CaptureFixture[str]) -> None:
    state = Job(job_works.stumble).wait(LONG_S)
    assert state.status == "failed"
    assert "a fault in benchtool itself, ZeroDivisionError" in state.error
    assert "ZeroDivisionError" in capfd.readouterr().err


def test_a_process_that_dies_is_told() -> None:
    state = Job(job_works.fall).wait(LONG_S)
    assert state.status == "failed"
    assert "exit code 9" in state.error


def test_cancel_ends_the_process() -> None:
    job = Job(job_works.linger)
    assert job.state.running
    job.cancel()
    state = job.wait(LONG_S)
    assert state.status == "cancelled"
    job.cancel()
    assert job.state.status == "cancelled"


@pytest.mark.skipif(sys.platform == "win32", reason="no niceness there")
def test_it_runs_elsewhere_and_below_the_server() -> None:
    state = Job(job_works.name_own_process).wait(LONG_S)
    assert state.result is not None
    pid, niceness = state.result
    assert pid != os.getpid()
    assert niceness >= min(os.nice(0) + NICENESS, 19)
