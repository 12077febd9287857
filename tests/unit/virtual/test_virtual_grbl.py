"""The virtual G-code stage answers what Grbl 1.1h answers, and the host's stage gets on with it."""

from __future__ import annotations

import pytest

from benchtool.bench.stage.grbl import GrblAxis, GrblStage
from benchtool.core.errors import StageError
from benchtool.virtual.grbl import VirtualGrbl
from benchtool.virtual.grbl_motion import StageHardware

TRAVEL_MM = dict.fromkeys("XYZ", 1500.0)
BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
HOMED_S = 5.0
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


def homed(at_mm: float = -1.0) -> VirtualGrbl:
    stage = VirtualGrbl(TRAVEL_MM, at_mm)
    stage.step(b"$H\n", 0.0)
    assert stage.step(b"", HOMED_S).endswith(b"ok\r\n")
    return stage


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
    # Where it stands when the power comes on is 0, and means nothing.
    assert stage.step(b"?", 0.1).startswith(b"<Alarm|MPos:0.000,0.000,0.000|FS:0,0|WCO:")


def test_no_question_is_answered_while_it_homes() -> None:
    stage = VirtualGrbl(TRAVEL_MM, -30.0)
    stage.step(b"$H\n", 0.0)
    assert stage.step(b"?", 0.5) == stage.step(b"?", 1.2) == b""
    home, ok, _ = stage.step(b"", 2.0).split(b"\r\n")
    assert home.startswith(b"<Home|MPos:-1.000,-1.000,-1.000|FS:0,0|")
    assert ok == b"ok"
    assert stage.step(b"?", 4.1).startswith(b"<Idle|MPos:-1.000,-1.000,-1.000|FS:0,0")


@pytest.mark.parametrize(("what", "alarm"), [("missing", b"ALARM:9"), ("stuck", b"ALARM:8")])
def test_a_homing_that_fails_says_ok_and_starts_anew_by_itself(what: str, alarm: bytes) -> None:
    stage = VirtualGrbl({"Z": 300.0}, hardware=StageHardware(**{what: {"Z"}}))
    stage.step(b"$H\n", 0.0)
    said = b"".join(stage.step(b"", 0.01 * number) for number in range(1100))
    assert said == alarm + b"\r\nok\r\n" + BANNER + LOCK


def test_ok_means_queued_and_a_dwell_waits() -> None:
    stage = homed()
    assert stage.step(b"G21 G90 G53 G1 Z-101 F6000\nG4 P0\n", 5.0).endswith(b"ok\r\n")
    # Half of the way after half of the time; it speeds up and slows down for 0.2 s each.
    assert stage.step(b"?", 5.6).startswith(b"<Run|MPos:-1.000,-1.000,-51.000|FS:6000,0")
    assert stage.step(b"", 6.21) == b"ok\r\n"
    assert stage.state == "Idle"


def test_a_soft_limit_silences_it_until_a_reset_that_is_not_too_early() -> None:
    stage = homed()
    assert stage.step(b"G53 G1 Z-1600 F600\n", 5.0) == b"ALARM:2\r\n"
    assert stage.step(b"\x18", 5.3) == b""
    assert stage.step(b"", 5.6) == b"[MSG:Reset to continue]\r\n"
    assert stage.step(b"?$X\nG4 P0\n", 6.0) == b""
    assert stage.step(b"\x18", 6.1) + stage.step(b"", 6.2) == b"ok\r\n" + BANNER + LOCK


def test_a_limit_switch_on_the_way_is_a_hard_limit() -> None:
    stage = VirtualGrbl(TRAVEL_MM, settings={21: 1})
    stage.step(b"$X\nG53 G1 Z-101 F6000\n", 0.0)
    stage.step(b"", 0.5)
    stage.switch("Z", closed=True)
    assert stage.step(b"", 1.1) == b"ALARM:1\r\n[MSG:Reset to continue]\r\n"
    said = stage.step(b"\x18", 1.2) + stage.step(b"", 1.3)
    assert said == BANNER + b"[MSG:Check Limits]\r\n" + LOCK


def test_a_hold_is_resumed_only_when_it_stands() -> None:
    stage = homed()
    stage.step(b"G53 G1 Z-101 F6000\n", 5.0)
    stage.step(b"!", 5.5)
    assert stage.step(b"~?", 5.52).startswith(b"<Hold:1|")
    assert stage.step(b"?", 5.8).startswith(b"<Hold:0|MPos:-1.000,-1.000,-51.000")
    stage.step(b"~", 5.8)
    assert stage.step(b"?", 7.0).startswith(b"<Idle|MPos:-1.000,-1.000,-101.000")


def test_buttons_hold_go_on_and_abort() -> None:
    stage = homed()
    stage.step(b"G53 G1 Z-301 F6000\n", 5.0)
    stage.press("H")
    assert b"|Pn:H" in stage.step(b"?", 5.4)
    stage.release()
    stage.press("S")
    assert stage.step(b"?", 5.6).startswith(b"<Run|")
    stage.press("R")
    assert stage.step(b"", 6.2) == b"ALARM:3\r\n" + BANNER + LOCK


@pytest.mark.parametrize(("line", "alarm"), [(b"$H\n", b"ALARM:6"), (b"G1 Z-90 F60\n", b"ALARM:3")])
def test_a_reset_on_the_way_loses_the_position(line: bytes, alarm: bytes) -> None:
    stage = VirtualGrbl(TRAVEL_MM, -400.0)
    stage.step(b"$X\n", 0.0)
    stage.step(line, 0.1)
    said = stage.step(b"\x18", 0.5) + stage.step(b"", 1.1)
    assert said.replace(b"ok\r\n", b"") == alarm + b"\r\n" + BANNER + LOCK


def test_lost_steps_are_seen_by_nobody_until_it_homes() -> None:
    stage = homed()
    stage.step(b"G53 G1 Z-101 F6000\n", 5.0)
    stage.step(b"", 5.5)
    stage.hardware.lost_mm["Z"] = 40.0
    assert b"MPos:-1.000,-1.000,-101.000" in stage.step(b"?", 7.0)
    assert stage.true_mm["Z"] == pytest.approx(-61.0)
    stage.step(b"$H\n", 7.0)
    stage.step(b"", 15.0)
    assert stage.true_mm["Z"] == -1.0


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (b"G1 Z-10\n", b"error:22"),
        (b"G99 Z-10 F60\n", b"error:20"),
        (b"G1 Z F60\n", b"error:2"),
        (b"10\n", b"error:1"),
        (b"$Q=1\n", b"error:2"),
        (b"\r\n", b"ok\r\nok"),
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
    # 1.3 m at 0.1 m/s, after 2 s of homing.
    assert link.now_s == pytest.approx(15.2, abs=0.5)


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
