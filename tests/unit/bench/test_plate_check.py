"""Where a plate may go, and what its own reading says of where it went."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan, pi
from types import SimpleNamespace

import numpy as np
import pytest

from benchtool.bench.bench import Readings
from benchtool.bench.motor_state import SPIN_DOWN_S
from benchtool.bench.plate_check import (
    PlateCheck,
    check_travel,
    plate_tolerance_m,
    wait_for_idle,
)
from benchtool.core.channel import Channel
from benchtool.core.errors import StageError
from benchtool.core.rig import Sensor
from benchtool.core.rig_file import load_rig_by_name

RIG = load_rig_by_name("pquad_single")
CHANNELS = (Channel("plate_z_m", "m"), Channel("rpm1", "rpm"))
TOLERANCE_M = PlateCheck(CHANNELS, RIG).tolerance_m
LEAST_M = RIG.plate.z_min_m
TO_HALF_M = 0.5 - TOLERANCE_M


def moved(before_m: float, *read_m: float) -> PlateCheck:
    """Return a check that read one position before a move and others after it."""
    plate = PlateCheck(CHANNELS, RIG)
    plate.update(np.array([[before_m, nan]]))
    plate.record_departure()
    plate.record_arrival()
    plate.update(np.array([[one, nan] for one in read_m]).reshape(-1, 2))
    return plate


def test_the_tolerance_is_that_of_drive_and_sensor():
    noisy = replace(RIG, sensors={"plate_z_m": Sensor(noise=0.002, quantum=0.0003)})
    assert plate_tolerance_m(noisy) == pytest.approx(0.0013 + RIG.plate.backlash_m + 0.008)
    assert pytest.approx(0.001 + RIG.plate.backlash_m + 0.0001) == TOLERANCE_M
    assert RIG.plate.backlash_m > 0.0


@pytest.mark.parametrize(
    ("read_m", "target_m", "stage_m", "more_m", "said"),
    [
        ((0.2,), 0.2, 0.2, 0.0, None),
        ((0.9, 0.2, nan), 0.2, 0.2, 0.0, None),
        ((0.2,), 0.2, 0.202, 0.001, None),
        ((1.0,), 1.0, 0.5, TO_HALF_M, None),
        ((0.2,), 0.2, 0.2 + 1.1 * TOLERANCE_M, 0.0, r"reports 0\.2017 m, tolerance 1\.5 mm"),
        ((0.2012,), 0.2, 0.1996, 0.0, r"reads 0\.2012 m .* the stage reports 0\.1996 m"),
        ((0.2016,), 0.2, 0.2008, 0.0, r"reads 0\.2016 m .* the stage reports 0\.2008 m"),
        ((0.2004,), 0.2, 0.1996, 0.0, None),
        ((LEAST_M - TOLERANCE_M,), LEAST_M - 0.5 * TOLERANCE_M, LEAST_M - TOLERANCE_M, 0.0, None),
        ((), 0.2, 0.2, 0.0, "has no reading after the move to 0.2 m"),
        ((nan,), 0.2, 0.2, 0.0, "has no reading after the move to 0.2 m"),
        ((LEAST_M - 0.002,), 0.06, 0.06, 9.0, "reads 0.0480 m .*, inside the minimum gap of 0.05"),
        (
            (0.6,),
            0.2,
            0.2,
            0.0,
            r"still reads 0.6000 m after the move to 0.2 m, tolerance 1\.\d mm",
        ),
        ((0.6,), 0.6, 0.7, 0.0, "reads 0.6000 m after the move .*, the stage reports 0.7000 m"),
        ((0.21,), 0.2, 0.2, 0.0, r"z_m reads 0.2100 m after the move to 0.2 m, tolerance 1\.\d mm"),
        ((0.61,), 0.2, 0.2, 0.02, r"still reads 0.6100 m .*, tolerance 21\.\d mm"),
    ],
)
def test_a_reading_after_a_move(read_m, target_m, stage_m, more_m, said):
    problem = moved(0.6, *read_m).find_error(target_m, stage_m, more_m)
    if said is None:
        assert problem is None
    else:
        assert isinstance(problem, StageError)
        with pytest.raises(StageError, match=said):
            raise problem


def test_a_move_within_the_tolerance_is_not_called_frozen():
    problem = moved(0.5, 0.5).find_error(1.0, 9.0, TO_HALF_M)
    assert problem is not None
    assert "still reads" not in str(problem)
    problem = moved(0.5, 1.0).find_error(2.0, 2.0, TO_HALF_M)
    assert problem is not None
    assert "still reads" in str(problem)


@pytest.mark.parametrize(
    ("mean_m", "more_m", "said"),
    [
        (0.5, 0.0, None),
        (1.0, TO_HALF_M, None),
        (0.51, 0.0, r"moved while motors turned: .* 0\.5100 m .* 0\.5000 m, tolerance 1\.\d mm"),
        (0.6, 0.05, r"moved while motors turned: .*, tolerance 51\.\d mm"),
        (nan, 0.0, "has no reading during the point at 0.5 m"),
    ],
)
def test_a_plate_that_moves_during_a_point(mean_m, more_m, said):
    problem = moved(0.5).check_position(0.5, mean_m, *([more_m] if more_m else []))
    assert (problem is None) == (said is None)
    if problem is not None:
        with pytest.raises(StageError, match=said):
            raise problem


def test_without_a_position_channel_nothing_is_judged():
    plate = PlateCheck(CHANNELS[1:], RIG)
    plate.update(np.array([[3.0]]))
    assert not plate.is_measured
    assert np.isnan(plate.read_m)
    assert plate.find_error(0.2, 0.2) is None
    assert plate.find_error(0.2, 0.9, 0.002) is None  # what an operator typed was compared before
    assert "the stage reports 0.9000 m" in str(plate.find_error(0.2, 0.9))
    assert "the stage reports nan m" in str(plate.find_error(0.2, nan))
    assert plate.check_position(0.2, nan) is None


@pytest.mark.parametrize(
    ("z_m", "x_m", "tilt_rad", "said"),
    [
        (RIG.plate.z_min_m, RIG.plate_x_max_m, 0.1, None),
        (RIG.plate.z_max_m, -RIG.plate_x_max_m, -0.1, None),
        (RIG.plate.z_min_m - 1e-6, 0.0, 0.0, "outside 0.05 to 1.5 m"),
        (RIG.plate.z_max_m + 1e-6, 0.0, 0.0, "outside 0.05 to 1.5 m"),
        (nan, 0.0, 0.0, "outside"),
        (0.5, RIG.plate_x_max_m + 1e-6, 0.0, "sideways"),
        (0.5, nan, 0.0, "sideways"),
        (0.5, 0.0, inf, "tilted"),
    ],
)
def test_where_a_plate_may_go(z_m, x_m, tilt_rad, said):
    if said is None:
        assert check_travel(RIG, z_m, x_m, tilt_rad) is None
    else:
        with pytest.raises(StageError, match=said):
            check_travel(RIG, z_m, x_m, tilt_rad)


START_US = RIG.propulsion.pwm_start_us
SLOW_RPM = 1.5 * RIG.propulsion.speed_per_us_rad_s * 20.0 * 30.0 / pi + 60.0
"""The limit for a device that idles 20 us above the start of the map."""


class Idling:
    """Be a guarded bench whose one rotor is read at some speeds, the same each time."""

    def __init__(self, idle_us: float | None, pwm_us: float, *rpm: float) -> None:
        self.identity = SimpleNamespace(pwm_idle_us=idle_us, channels=CHANNELS)
        self.pwm_us = np.array([pwm_us])
        self.time_s = 0.0
        self._rpm = rpm

    def now_s(self) -> float:
        return self.time_s

    def read_and_buffer(self, timeout_s: float) -> Readings:
        self.time_s += timeout_s
        values = np.array([[nan, rpm] for rpm in self._rpm])
        return Readings(np.full(len(values), self.time_s), np.zeros(len(values)), values)


@pytest.mark.parametrize(
    ("idle_us", "pwm_us", "rpm"),
    [
        (None, START_US, (60.0,)),
        (START_US + 20.0, START_US + 20.0, (0.999 * SLOW_RPM,)),
        (START_US + 20.0, START_US, (9e3, 100.0)),
        (START_US + 20.0, START_US, (9e3, 100.0, nan)),
    ],
)
def test_a_plate_moves_beside_rotors_at_idle(idle_us, pwm_us, rpm):
    bench = Idling(idle_us, pwm_us, *rpm)
    wait_for_idle(bench, RIG)
    assert bench.time_s <= 0.1


@pytest.mark.parametrize(
    ("idle_us", "pwm_us", "rpm", "said", "within_s"),
    [
        (None, START_US + 0.1, (0.0,), "motor 1 is commanded .* above idle at", 0.0),
        (None, START_US, (61.0,), "a rotor still turns at 61 rpm 4 s after idle", SPIN_DOWN_S),
        (START_US + 20.0, START_US, (1.001 * SLOW_RPM,), "still turns", SPIN_DOWN_S),
        (START_US + 20.0, START_US, (100.0, 9e3), "turns at 9000 rpm", SPIN_DOWN_S),
        (None, START_US, (nan,), "turns at nan rpm", SPIN_DOWN_S),
    ],
)
def test_a_plate_does_not_move_beside_faster_ones(idle_us, pwm_us, rpm, said, within_s):
    bench = Idling(idle_us, pwm_us, *rpm)
    with pytest.raises(StageError, match=said):
        wait_for_idle(bench, RIG)
    assert within_s <= bench.time_s <= within_s + 0.11
