"""What a guarded bench sends and refuses, every sample held against its limits, and its ends."""

from __future__ import annotations

import signal
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchtool.bench.guard import GuardedBench
from benchtool.core import errors
from benchtool.core.channel import Channel
from tests.unit.bench.guarded_fake import RIG, FakeBench

TALKS = Path(__file__).with_name("guard_talks.txt").read_text("utf-8").strip().split("\n\n")
"""Calls of a guarded bench and what happens to the bench behind it, in order. A call may bring an
error that the run survives (`!`) or that leaves the guard (`!!`). Then what became of it."""

SHOWN: dict[str, Callable[[float], float]] = {
    "wobble": lambda time_s: 0.05 * np.sin(99.0 * time_s),
    "flicker": lambda time_s: 0.01 * (time_s % 0.02),
}


ERRORS = {**vars(errors), "ZeroDivisionError": ZeroDivisionError}


def error_of(kind: str, words: str) -> Exception:
    return ERRORS[kind](*(["pwm"] if kind == "CommandRefused" else []), words)


def spoil(fake: FakeBench, name: str, shown: str, *span: str) -> None:
    """Let a channel show something else, in a span of time if one is given."""
    times = dict(zip(span[::2], map(float, span[1::2]), strict=True))
    before = fake.spoil

    def spoilt(time_s: float, row: dict[str, float]) -> dict[str, float]:
        row = before(time_s, row)
        if shown == "seldom":
            return row | ({name: np.nan} if time_s % 0.5 > 0.011 else {})
        value = SHOWN[shown](time_s) if shown in SHOWN else float(shown)
        within = times.get("from", -1.0) < time_s < times.get("to", 1e9)
        return row | ({name: value} if within else {})

    fake.spoil = spoilt


def prepared(fake: FakeBench, what: str, words: list[str]) -> dict[str, Any]:
    """Make the bench special before it is guarded; return what else the guard is given."""
    channels = fake.identity.channels
    if what == "broken":
        fake.failing = {words[0]: error_of(words[1], " ".join(words[2:]))}
    elif what == "limit":
        return {"limits": replace(RIG.limits, pwm_us=float(words[0]))}
    elif what == "channels":
        fake.identity = replace(fake.identity, channels=channels[: int(words[0])])
    else:
        facts = {"mode": "pitch"} if what == "fact" else {}
        more = (*channels, Channel(words[0], "us"))
        fake.identity = replace(fake.identity, channels=more, has_loop=not facts, facts=facts)
    return {}


def do(guard: GuardedBench, fake: FakeBench, text: str) -> None:
    """Make one call, or let something happen to the bench."""
    name, *words = text.split()
    numbers = [float(word) for word in words if not word[0].isalpha() or word == "nan"]
    if name == "read":
        for _ in range(int(words[1][1:]) if words[1:] else 1):
            guard.read(numbers[0])
    elif name == "pwm":
        guard.set_pwm(np.array(numbers))
    elif name == "signal":
        signal.raise_signal(getattr(signal, words[0]))
    elif name == "pause":
        fake.clock_s += numbers[0]
    elif name == "tail":
        fake.tail_rpm = numbers[0]
    elif name == "spoil":
        spoil(fake, *words)
    elif name == "break":
        fake.failing |= {words[0]: error_of(words[1], " ".join(words[2:]))}
    elif name == "whole":
        fake.failing = {}
    elif name == "commanded":
        assert guard.pwm_us.tolist() == numbers
    elif name == "fail":
        _ = 1 / 0
    else:
        called = {"move": guard.move_plate, "ready": guard.check_ready_for_move}.get(name)
        (called or getattr(guard, name))(*numbers)


def check(guard: GuardedBench, fake: FakeBench, text: str, ended: Any) -> None:
    """Compare what became of a run."""
    name, _, rest = text.partition(" ")
    items = rest.split(", ")
    if name == "did":
        assert fake.did == items
    elif name == "last":
        assert fake.did[-len(items) :] == items
    elif name == "once":
        assert fake.did.count(rest) == 1
    elif name == "never":
        assert not [item for item in fake.did if item.startswith(rest)]
    elif name == "reason":
        start, _, end = rest.partition(" [..] ")
        assert (guard.reason or "-").startswith(start)
        assert (guard.reason or "-").endswith(end or start)
    elif name == "cause":
        assert type(ended.value.__cause__).__name__ == rest
    elif name == "troubles":
        assert guard.cleanup_errors == items
    elif name == "standstill":
        assert rest in guard.standstill.text
    elif name == "unread":
        assert len(guard.pop_unread()) == int(rest)
    elif name == "stopped":
        at_s, within_s = map(float, rest.split())
        assert fake.stopped_s == pytest.approx(at_s, abs=within_s)
    else:
        raise AssertionError(f"{name} is no check")


CHECKS = (
    "did",
    "last",
    "once",
    "never",
    "reason",
    "cause",
    "troubles",
    "standstill",
    "unread",
    "stopped",
)


@pytest.mark.parametrize("talk", TALKS, ids=lambda talk: talk.split("\n")[0])
def test_a_guarded_bench(talk, fake):
    _, *lines = talk.split("\n")
    given: dict[str, Any] = {}
    while lines[0].startswith("with "):
        _, what, *words = lines.pop(0).split()
        given |= prepared(fake, what, words)
    calls = [line for line in lines if line.split()[0] not in CHECKS]
    _, _, leaves = calls[-1].partition(" !! ")
    kind, _, said = leaves.partition(" ")
    guard = GuardedBench(fake, RIG, **given)
    before = signal.getsignal(signal.SIGINT)
    raised = pytest.raises(ERRORS[kind], match=said or None) if kind else nullcontext()
    with raised as ended, guard:
        for line in calls:
            text, _, survived = line.partition(" !! ")[0].partition(" ! ")
            kind, _, said = survived.partition(" ")
            with pytest.raises(ERRORS[kind], match=said or None) if kind else nullcontext():
                do(guard, fake, text)
    for line in lines[len(calls) :]:
        check(guard, fake, line, ended)
    assert fake.did[-1] == "close"
    assert signal.getsignal(signal.SIGINT) is before
