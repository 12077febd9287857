"""A scope that defers signals, and an inner one in which they are raised at once."""

# ruff: noqa: PT012 -- what happens after a signal needs the whole body inside `raises`

import os
import signal
import threading
from contextlib import suppress

import numpy as np
import pytest

from benchtool.bench.guard import GuardedBench
from benchtool.bench.stop_requests import SHUTDOWN_TIMEOUT_S, ClosingSignals, StopSignals
from benchtool.core.errors import RunInterrupted
from tests.unit.bench.guarded_fake import RIG


@pytest.fixture
def signals():
    scope = StopSignals(lambda reason: None)
    scope.install()
    yield scope
    scope.restore()


def test_a_signal_is_noted_and_raised_when_asked_for(signals):
    signal.raise_signal(signal.SIGTERM)
    for _ in range(2):
        with pytest.raises(RunInterrupted, match="stopped by SIGTERM; zero was commanded"):
            signals.raise_if_requested()


def test_a_signal_ends_one_scope_and_not_the_next(signals):
    signal.raise_signal(signal.SIGTERM)
    signals.restore()
    signals.install()
    assert signals.raise_if_requested() is None


def test_within_the_inner_scope_it_is_raised_at_once(signals):
    reached = []
    with pytest.raises(RunInterrupted, match="stopped by Ctrl-C"), signals.interruptible():
        signal.raise_signal(signal.SIGINT)
        reached.append("after")
    assert reached == []
    signal.raise_signal(signal.SIGINT)  # behind it they are deferred again


def test_one_that_was_noted_before_is_raised_on_entering(signals):
    signal.raise_signal(signal.SIGTERM)
    with pytest.raises(RunInterrupted), signals.interruptible():
        pytest.fail("the body must not run")


def test_only_the_first_is_raised_at_once(signals):
    with pytest.raises(RunInterrupted), signals.interruptible():
        try:
            signal.raise_signal(signal.SIGINT)
        finally:
            signal.raise_signal(signal.SIGTERM)


@pytest.mark.parametrize("call", ["set_pwm", "read", "read_and_buffer", "stop", "close"])
def test_no_call_of_a_guarded_bench_is_cut_in_two(fake, call):
    done = []
    plain = getattr(fake, "read" if call == "read_and_buffer" else call)

    def signalled(*words):
        if not done:
            signal.raise_signal(signal.SIGINT)
        done.append(call)
        return plain(*words)

    setattr(fake, "read" if call == "read_and_buffer" else call, signalled)
    stopped = pytest.raises(RunInterrupted, match="Ctrl-C")
    with stopped, GuardedBench(fake, RIG) as guard:
        guard.set_pwm(np.array([1500.0]))
        guard.read_and_buffer(0.1)
        guard.read(0.1)
        guard.stop()
        guard.read(0.1)
        if call == "close":
            raise RunInterrupted("Ctrl-C")
    assert done[0] == call
    assert fake.did[-1] == "close"


def test_a_move_of_the_plate_is_interrupted(fake):
    def move(*place):
        signal.raise_signal(signal.SIGINT)
        pytest.fail("the move went on")

    fake.move_plate = move
    with pytest.raises(RunInterrupted), GuardedBench(fake, RIG) as guard:
        guard.move_plate(0.5)
    assert fake.did[-2:] == ["stop", "close"]


posix = pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")


@posix
def test_signals_are_ignored_once_begun_and_told_once(capfd):
    now_s = 100.0
    before = signal.getsignal(signal.SIGINT)
    with ClosingSignals(lambda: now_s) as closing:
        closing.ignore_signals()
        for number in (signal.SIGINT, signal.SIGINT, signal.SIGTERM, signal.SIGINT):
            signal.raise_signal(number)
        now_s += SHUTDOWN_TIMEOUT_S - 0.1
        signal.raise_signal(signal.SIGINT)
        now_s += 0.1
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before
    assert capfd.readouterr().err.count("the run is being closed") == 1


@posix
def test_before_there_is_a_run_signals_mean_what_they_did():
    with ClosingSignals(), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


@posix
def test_before_there_is_a_run_a_request_to_end_ends_the_program():
    if not (child := os.fork()):
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        with ClosingSignals(), suppress(BaseException):
            signal.raise_signal(signal.SIGTERM)
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGTERM


def test_outside_of_the_main_thread_a_guard_reads_without_signals(fake):
    read: list[int] = []

    def drive() -> None:
        with GuardedBench(fake, RIG) as guard:
            guard.set_pwm(np.array([1500.0]))
            read.append(len(guard.read(0.1)))

    thread = threading.Thread(target=drive)
    thread.start()
    thread.join()
    assert read == [10]
    assert fake.did[-1] == "close"
