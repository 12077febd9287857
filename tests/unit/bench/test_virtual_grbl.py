"""The virtual G-code stage answers what Grbl 1.1h answers, and the host's stage gets on with it."""

from __future__ import annotations

import pytest

from benchtool.bench.grbl_stage import GrblStage
from benchtool.bench.grbl_way import GrblAxis
from benchtool.bench.virtual_grbl import VirtualGrbl
from benchtool.errors import StageError

TRAVEL_MM = dict.fromkeys("XYZ", 1500.0)
BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
LOCK = b"[MSG:'$H'|'$X' to unlock]\r\n"


class Looped:
    """Carry bytes to a virtual stage on a clock that only reading moves."""

    baud = None

    def __init__(self) -> None:
        self.stage = VirtualGrbl(TRAVEL_MM)
        self.now_s = 0.0
        self._answer = b""

    def clock(self) -> float:
        return self.now_s

    def open(self) -> None:
        self._answer = b""

    def read(self, timeout_s: float) -> bytes:
        self.now_s += timeout_s
        data, self._answer = self._answer + self.stage.step(b"", self.now_s), b""
        return data

    def write(self, data: bytes) -> None:
        self._answer += self.stage.step(data, self.now_s)

    def close(self) -> None:
        pass


def ready() -> VirtualGrbl:
    stage = VirtualGrbl(TRAVEL_MM)
    stage.step(b"$X\n", 0.0)
    return stage


def host(link: Looped) -> GrblStage:
    return GrblStage(link, GrblAxis("Z", 1.5), 0.1, clock=link.clock)


def quiet(duration_s: float) -> None:
    pass


def test_it_starts_locked_and_says_so() -> None:
    stage = VirtualGrbl(TRAVEL_MM)
    assert stage.step(b"", 0.0) == BANNER + LOCK
    assert stage.step(b"G21 G90 G53 G1 Z-10 F600\n", 0.1) == b"error:9\r\n"
    assert stage.step(b"?", 0.1).startswith(b"<Alarm|MPos:-1.000,-1.000,-1.000|FS:0,0|WCO:")


def test_no_question_is_answered_while_it_homes() -> None:
    stage = VirtualGrbl(TRAVEL_MM)
    stage.step(b"$H\n", 0.0)
    assert stage.step(b"?", 1.0) == stage.step(b"?", 3.9) == b""
    assert stage.step(b"", 4.0) == b"ok\r\n"
    assert stage.step(b"?", 4.1).startswith(b"<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0")


def test_ok_means_queued_and_a_dwell_waits() -> None:
    stage = ready()
    assert stage.step(b"G21 G90 G53 G1 Z-101 F6000\nG4 P0\n", 0.0).endswith(b"ok\r\n")
    assert stage.step(b"?", 0.5).startswith(b"<Run|MPos:-1.000,-1.000,-51.000|FS:6000,0")
    assert stage.step(b"", 1.01) == b"ok\r\n"
    assert stage.state == "Idle"


def test_a_soft_limit_silences_it_until_a_reset() -> None:
    stage = ready()
    said = stage.step(b"G53 G1 Z-1600 F600\n", 0.0)
    assert b"ALARM:2\r\n[MSG:Reset to continue]\r\n" in said
    assert stage.step(b"?$X\nG4 P0\n", 5.0) == b""
    assert stage.step(b"\x18", 5.1) == BANNER + LOCK


def test_a_hold_is_resumed_only_when_it_stands() -> None:
    stage = ready()
    stage.step(b"G53 G1 Z-101 F6000\n", 0.0)
    stage.step(b"!", 0.5)
    assert stage.step(b"~?", 0.52).startswith(b"<Hold:1|")
    assert stage.step(b"?", 0.7).startswith(b"<Hold:0|MPos:-1.000,-1.000,-51.000")
    stage.step(b"~", 0.7)
    assert stage.step(b"?", 2.0).startswith(b"<Idle|MPos:-1.000,-1.000,-101.000")


@pytest.mark.parametrize(("line", "alarm"), [(b"$H\n", b"ALARM:6"), (b"G1 Z-90 F60\n", b"ALARM:3")])
def test_a_reset_on_the_way_loses_the_position(line: bytes, alarm: bytes) -> None:
    stage = ready()
    stage.step(line, 0.0)
    assert stage.step(b"\x18", 0.5) == alarm + b"\r\n" + BANNER + LOCK


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (b"G1 Z-10\n", b"error:22"),
        (b"G2 Z-10 F60\n", b"error:20"),
        (b"G1 Z F60\n", b"error:2"),
        (b"10\n", b"error:1"),
        (b"$#\n", b"ok"),
    ],
)
def test_lines_are_refused_by_number(line: bytes, said: bytes) -> None:
    stage = ready()
    stage.step(b"", 0.0)
    assert stage.step(line, 0.1) == said + b"\r\n"


def test_the_host_homes_moves_and_waits_for_it() -> None:
    link = Looped()
    stage = host(link)
    stage.open()
    assert stage.move(0.2, 0.0, 0.0, quiet) == pytest.approx(0.2)
    # 1.3 m at 0.1 m/s, after 4 s of homing.
    assert link.now_s == pytest.approx(17.0, abs=1.0)


def test_the_host_leaves_a_soft_limit_by_a_reset_and_goes_on() -> None:
    stage = host(Looped())
    stage.open()
    with pytest.raises(StageError, match="ALARM:2, the target lies outside"):
        stage.move(1.6, 0.0, 0.0, quiet)
    assert stage.move(1.4, 0.0, 0.0, quiet) == pytest.approx(1.4)


def test_the_host_goes_on_from_a_hold() -> None:
    link = Looped()
    stage = host(link)
    stage.open()
    paused: list[float] = []

    def hold_once(duration_s: float) -> None:
        paused.append(duration_s)
        if len(paused) == 100:
            stage.hold()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stage.move(0.2, 0.0, 0.0, hold_once)
    held_mm = link.stage.position_mm["Z"]
    assert stage.move(0.2, 0.0, 0.0, quiet) == pytest.approx(0.2)
    assert -1300.0 < held_mm < -1.0


def test_what_waits_beside_it_is_listened_to_while_it_homes() -> None:
    link, heard = Looped(), []
    GrblStage(link, GrblAxis("Z", 1.5), 0.1, clock=link.clock, opening=heard.append).open()
    assert len(heard) > 50
