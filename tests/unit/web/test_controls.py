from __future__ import annotations

from pathlib import Path

import pytest

from benchtool.web.bench_process.client import BenchClient
from benchtool.web.bench_process.messages import Command, HoldThrottle, ReleaseThrottle
from benchtool.web.context import (
    MAX_BEAT_SILENCE_S,
    MAX_BLOCKED_S,
    RECONNECT_TIMEOUT_S,
    ControlLock,
    PageWatch,
    ServerState,
)
from benchtool.web.control_socket import forward


class RecordingClient(BenchClient):
    """Record the commands to the bench process."""

    def __init__(self) -> None:
        super().__init__()
        self.commands: list[Command] = []

    def send(self, command: Command) -> None:
        self.commands.append(command)


@pytest.mark.parametrize(
    ("word", "commands"),
    [
        ("hold 7 1300 1,2 40", [HoldThrottle("a", 7, 1300.0, (1, 2), 0.04)]),
        ("release 7", [ReleaseThrottle("a", 7)]),
        ("hold 7 1300 1,2", []),
        ("hold 7 nan 1 0", []),
        ("hold 7 1300 1 -40", []),
        ("hold 7 1300 1 40\n", []),
        ("release", []),
        ("arm", []),
    ],
)
def test_only_whole_reports_of_the_throttle_are_forwarded(word, commands):
    bench = RecordingClient()
    forward(ServerState(runs=Path("runs"), bench=bench), "a", word)
    assert bench.commands == commands


def test_the_first_page_is_at_the_controls_and_others_watch():
    lock = ControlLock()
    lock.arrive("a")
    lock.arrive("b")
    assert lock.held_by("a")
    assert not lock.held_by("b")
    assert not lock.is_free(1e9)
    assert not lock.take("b", 1e9)
    assert lock.held_by("a")


def test_a_page_that_is_loaded_again_keeps_the_controls():
    lock = ControlLock()
    lock.arrive("a")
    lock.arrive("b")
    lock.leave("a", 10.0)
    assert not lock.take("b", 10.0 + 0.5 * RECONNECT_TIMEOUT_S)
    lock.arrive("a")
    assert lock.held_by("a")
    assert not lock.take("b", 100.0)


def test_the_new_socket_of_a_page_may_come_before_the_old_one_goes():
    lock = ControlLock()
    lock.arrive("a")
    lock.arrive("a")
    lock.leave("a", 10.0)
    assert not lock.is_free(100.0)


def test_controls_of_a_page_that_is_gone_are_taken_by_hand_and_only_by_a_page():
    lock = ControlLock()
    lock.arrive("a")
    lock.arrive("b")
    lock.leave("a", 10.0)
    assert lock.held_by("a")
    assert not lock.take("c", 20.0)
    assert lock.take("b", 20.0)
    assert lock.held_by("b")
    lock.arrive("a")
    assert not lock.held_by("a")


def test_no_name_has_no_controls():
    assert not ControlLock().held_by("")


def test_a_page_that_responds_has_no_problem():
    watch = PageWatch()
    watch.beat("a", 0.1, 10.0)
    assert watch.problem("a", 10.0 + 0.9 * MAX_BEAT_SILENCE_S) == ""
    assert watch.problem(None, 10.0) == ""


@pytest.mark.parametrize(
    ("blocked_s", "later_s", "named"),
    [
        (0.0, 1.1 * MAX_BEAT_SILENCE_S, "no beat"),
        (1.05 * MAX_BLOCKED_S, 0.0, "blocked"),
        (MAX_BLOCKED_S - 0.1, 0.2, "blocked"),
    ],
)
def test_a_page_that_cannot_press_stop_is_named(blocked_s, later_s, named):
    watch = PageWatch()
    watch.beat("a", blocked_s, 10.0)
    assert named in watch.problem("a", 10.0 + later_s)


def test_a_page_that_is_closed_is_lost_and_another_takes_over_the_watch():
    watch, lock = PageWatch(), ControlLock()
    for tab in ("a", "b"):
        lock.arrive(tab)
        watch.beat(tab, 0.0, 10.0)
    watch.leave("a")
    lock.leave("a", 10.0)
    assert watch.problem(lock.holder, 10.0)
    assert lock.take("b", 10.0 + RECONNECT_TIMEOUT_S)
    watch.beat("b", 0.0, 10.0 + RECONNECT_TIMEOUT_S)
    assert watch.problem(lock.holder, 10.0 + RECONNECT_TIMEOUT_S) == ""
