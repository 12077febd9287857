"""Impatient signals while a run is being closed are heard, told once, and end nothing for 10 s."""

from __future__ import annotations

import os
import signal

import pytest

from benchtool.bench.signals import PATIENCE_S, ClosingSignals

posix = pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")


@posix
def test_signals_are_ignored_once_begun_and_told_once(capfd: pytest.CaptureFixture[str]) -> None:
    now_s = 0.0
    before = signal.getsignal(signal.SIGINT)
    with ClosingSignals(lambda: now_s) as closing:
        closing.begin()
        for number in (signal.SIGINT, signal.SIGINT, signal.SIGTERM, signal.SIGINT):
            signal.raise_signal(number)
        now_s = PATIENCE_S
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before
    assert capfd.readouterr().err.count("the run is being closed") == 1


@posix
def test_before_there_is_a_run_signals_mean_what_they_did() -> None:
    with ClosingSignals(), pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
