"""Standstill problems are shown on every page until a user dismisses them."""

from __future__ import annotations

import pickle
from multiprocessing import Pipe

import pytest

from benchtool.core.errors import LinkLost, StandstillNotConfirmed
from benchtool.web.application import status_parts
from benchtool.web.bench_process import process
from benchtool.web.bench_process.client import BenchClient
from benchtool.web.bench_process.messages import Connect, ConnectionStatus

TURNING = StandstillNotConfirmed("MOTORS MAY STILL TURN: rpm1 4479, cut the power", 4479.0)


@pytest.mark.parametrize(("error", "problem"), [(TURNING, str(TURNING)), (LinkLost("gone"), "")])
def test_the_bench_process_tells_that_motors_may_still_turn(error, problem, monkeypatch):
    def fail(address: str) -> None:
        raise error

    monkeypatch.setattr(process, "open_bench", fail)
    pipe, child_pipe = Pipe()
    bench_process = process.BenchProcess(child_pipe)
    bench_process._serve_bench(Connect(address="sim:pquad"))
    _, status = [pickle.loads(pipe.recv_bytes()[1:]) for _ in range(2)]
    bench_process._publisher.close()
    assert isinstance(status, ConnectionStatus)
    assert (status.status, status.reason) == ("off", str(error))
    assert status.standstill_problem == problem


def test_what_is_known_of_motors_is_first_that_they_may_turn():
    bench = BenchClient()
    bench.connection = ConnectionStatus(reason=str(TURNING), standstill_problem=str(TURNING))
    assert status_parts(bench) == [str(TURNING)]
    bench.dismiss_alarm()
    assert status_parts(bench) == ["no bench is connected"]
    assert bench.connection.reason == ""
