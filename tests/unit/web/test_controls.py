from __future__ import annotations

from pathlib import Path

import pytest

from benchtool.web.bench_process.client import BenchClient
from benchtool.web.bench_process.messages import Command, HoldThrottle, ReleaseThrottle
from benchtool.web.context import (
    HEARTBEAT_TIMEOUT_S,
    MAX_BLOCKED_S,
    RECONNECT_TIMEOUT_S,
    ControlLock,
    PageWatch,
    ServerState,
)
from benchtool.web.sockets import forward


class RecordingClient(BenchClient):
    """Client that records its commands."""

    def __init__(self) -> None:
        super().__init__()
        self.commands: list[Command] = []

    def send(self, command: Command) -> None:
        self.commands.append(command)


@pytest.mark.parametrize(
    ("message", "commands"),
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
def test_only_whole_reports_of_the_throttle_are_forwarded(message, commands):
    bench = RecordingClient()
    forward(ServerState(runs=Path("runs"), bench=bench), "a", message)
    assert bench.commands == commands


def test_the_first_page_is_at_the_controls_and_others_watch():
    lock = ControlLock()
    lock.connect("a")
    lock.connect("b")
    assert lock.is_held_by("a")
    assert not lock.is_held_by("b")
    assert not lock.is_free(1e9)
    assert not lock.acquire("b", 1e9)
    assert lock.is_held_by("a")


def test_a_page_that_is_loaded_again_keeps_the_controls():
    lock = ControlLock()
    lock.connect("a")
    lock.connect("b")
    lock.disconnect("a", 10.0)
    assert not lock.acquire("b", 10.0 + 0.5 * RECONNECT_TIMEOUT_S)
    lock.connect("a")
    assert lock.is_held_by("a")
    assert not lock.acquire("b", 100.0)


def test_the_new_socket_of_a_page_may_come_before_the_old_one_goes():
    lock = ControlLock()
    lock.connect("a")
    lock.connect("a")
    lock.disconnect("a", 10.0)
    assert not lock.is_free(100.0)


def test_controls_of_a_page_that_is_gone_are_taken_by_hand_and_only_by_a_page():
    lock = ControlLock()
    lock.connect("a")
    lock.connect("b")
    lock.disconnect("a", 10.0)
    assert lock.is_held_by("a")
    assert not lock.acquire("c", 20.0)
    assert lock.acquire("b", 20.0)
    assert lock.is_held_by("b")
    lock.connect("a")
    assert not lock.is_held_by("a")


def test_no_name_has_no_controls():
    assert not ControlLock().is_held_by("")


def test_a_page_that_responds_has_no_problem():
    watch = PageWatch()
    watch.record_heartbeat("a", 0.1, 10.0)
    assert watch.find_problem("a", 10.0 + 0.9 * HEARTBEAT_TIMEOUT_S) == ""
    assert watch.find_problem(None, 10.0) == ""


@pytest.mark.parametrize(
    ("blocked_s", "later_s", "fragment"),
    [
        (0.0, 1.1 * HEARTBEAT_TIMEOUT_S, "no heartbeat"),
        (1.05 * MAX_BLOCKED_S, 0.0, "blocked"),
        (MAX_BLOCKED_S - 0.1, 0.2, "blocked"),
    ],
)
def test_a_page_that_cannot_press_stop_is_reported(blocked_s, later_s, fragment):
    watch = PageWatch()
    watch.record_heartbeat("a", blocked_s, 10.0)
    assert fragment in watch.find_problem("a", 10.0 + later_s)


def test_a_page_that_is_closed_is_lost_and_another_takes_over_the_watch():
    watch, lock = PageWatch(), ControlLock()
    for tab in ("a", "b"):
        lock.connect(tab)
        watch.record_heartbeat(tab, 0.0, 10.0)
    watch.disconnect("a")
    lock.disconnect("a", 10.0)
    assert watch.find_problem(lock.holder, 10.0)
    assert lock.acquire("b", 10.0 + RECONNECT_TIMEOUT_S)
    watch.record_heartbeat("b", 0.0, 10.0 + RECONNECT_TIMEOUT_S)
    assert watch.find_problem(lock.holder, 10.0 + RECONNECT_TIMEOUT_S) == ""
