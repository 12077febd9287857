"""Motors that were not seen to stand are reported on every page until somebody has looked."""

from __future__ import annotations

import pickle
from multiprocessing import Pipe

import pytest

from benchtool.core.errors import LinkLost, StandstillNotConfirmed
from benchtool.web.bench_process import process
from benchtool.web.bench_process.client import BenchClient
from benchtool.web.bench_process.messages import Connect, ConnectionStatus
from benchtool.web.header import status_parts

TURNING = StandstillNotConfirmed("MOTORS MAY STILL TURN: rpm1 4479, cut the power", 4479.0)


@pytest.mark.parametrize(("error", "unseen"), [(TURNING, str(TURNING)), (LinkLost("gone"), "")])
def test_the_bench_process_tells_that_motors_may_still_turn(error, unseen, monkeypatch):
    def refuse(address: str) -> None:
        raise error

    monkeypatch.setattr(process, "open_bench", refuse)
    ours, theirs = Pipe()
    held = process.BenchProcess(theirs)
    held._hold(Connect(address="sim:pquad"))
    events = [pickle.loads(ours.recv_bytes()[1:]) for _ in range(2)]
    held._publisher.close()
    _, ended = events
    assert isinstance(ended, ConnectionStatus)
    assert (ended.status, ended.reason, ended.unseen) == ("off", str(error), unseen)


def test_what_is_known_of_motors_is_first_that_they_may_turn():
    bench = BenchClient()
    bench.connection = ConnectionStatus(reason=str(TURNING), unseen=str(TURNING))
    assert status_parts(bench) == [str(TURNING)]
    bench.dismiss_alarm()
    assert status_parts(bench) == ["no bench is connected"]
    assert bench.connection.reason == ""
