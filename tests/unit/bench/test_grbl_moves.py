"""Moves, holds and homing of the stage driver with the double of Grbl 1.1h."""

from __future__ import annotations

import re

import pytest

from benchtool.core.errors import StageError
from tests.doubles.grbl import VirtualGrbl, grbl_stage
from tests.doubles.scripted_link import ScriptedLink


class Looped(ScriptedLink):
    """Carry bytes to a virtual stage on a clock that only reading moves."""

    def __init__(self) -> None:
        super().__init__()
        self.now_s = 0.0
        self.stage = VirtualGrbl(dict.fromkeys("XYZ", 1500.0))

    def read(self, timeout_s: float) -> bytes:
        self.now_s += timeout_s
        data, self._answer = self._answer + self.stage.step(b"", self.now_s), b""
        return data

    def write(self, data: bytes) -> None:
        self._answer += self.stage.step(data, self.now_s)


def quiet(duration_s: float) -> None:
    pass


class Misheard(Looped):
    """The stage reads another digit than was sent and would go on to its end of travel."""

    def write(self, data: bytes) -> None:
        super().write(re.sub(rb"Z-\d+", b"Z-1499", data))

    def read(self, timeout_s: float) -> bytes:
        return super().read(min(timeout_s, ANSWER_S) if self._answer else timeout_s)


ANSWER_S = 0.013  # 95 % of the answers of Grbl 1.1h came within it


@pytest.mark.parametrize("start_mm", range(0, 40, 4))
@pytest.mark.parametrize("z_m", [0.3, 0.08, 0.06, 0.052])
def test_a_plate_that_runs_past_its_target_is_held_outside_of_the_least_gap(z_m, start_mm):
    link = Misheard()
    stage = grbl_stage(link, z_min_m=0.05)
    stage.open()
    link.stage.position_mm["Z"] = -1000.0 - start_mm
    with pytest.raises(StageError, match="was held: it is at Z"):
        stage.move(z_m, 0.0, 0.0, link.pause)
    for _ in range(50):
        link.read(0.02)
    assert link.stage.state == "Hold:0"
    past_mm = 1e3 * z_m - 1500.0 - link.stage.position_mm["Z"]
    # 0.5 mm until it is off its way, 7 mm until the report, v^2 / (2 a) = 10 mm to brake.
    assert 0.5 < past_mm < 17.5
    assert link.stage.position_mm["Z"] > -1450.0


def test_a_distance_without_room_to_brake_is_refused_before_anything_moves():
    link = Looped()
    stage = grbl_stage(link, z_min_m=0.05)
    stage.open()
    # 0.5 mm until it is off its way, and 0.5 + 0.025 mm from 5 mm/s.
    with pytest.raises(
        StageError, match=r"not moved to 0\.051 m: feed 300 .* maximum: 286 mm/min;"
    ):
        stage.move(0.051, 0.0, 0.0, quiet)
    assert link.stage.position_mm["Z"] == -1.0
    assert stage.move(0.0511, 0.0, 0.0, quiet) == pytest.approx(0.0511)


def test_the_host_homes_moves_waits_and_leaves_a_soft_limit_by_a_reset():
    link, heard = Looped(), []
    stage = grbl_stage(link)
    stage._homing_pause = heard.append
    stage.open()
    assert len(heard) > 50  # what waits beside it is listened to while it homes
    assert stage.move(0.2, 0.0, 0.0, quiet) == pytest.approx(0.2)
    # 1.3 m at 0.1 m/s, after 2 s of homing.
    assert link.now_s == pytest.approx(15.2, abs=0.5)
    with pytest.raises(StageError, match="ALARM:2, the target is outside"):
        stage.move(1.6, 0.0, 0.0, quiet)
    assert stage.move(1.4, 0.0, 0.0, quiet) == pytest.approx(1.4)


def test_the_host_goes_on_from_a_hold():
    link = Looped()
    stage = grbl_stage(link)
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
