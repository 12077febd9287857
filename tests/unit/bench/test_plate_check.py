"""Where a plate may go, and what its own reading says of where it went."""

from __future__ import annotations

from math import inf, nan

import numpy as np
import pytest

from benchtool.bench.plate_check import PlateCheck, check_travel
from benchtool.core.channel import Channel
from benchtool.core.errors import StageError
from benchtool.core.rig_file import rig_named

RIG = rig_named("pquad_single")
CHANNELS = (Channel("plate_z_m", "m"), Channel("rpm1", "rpm"))
TOLERANCE_M = PlateCheck(CHANNELS, RIG).tolerance_m
LEAST_M = RIG.plate.z_min_m
TO_HALF_M = 0.5 - TOLERANCE_M


def moved(before_m: float, *read_m: float) -> PlateCheck:
    """Return a check that read one position before a move and others after it."""
    plate = PlateCheck(CHANNELS, RIG)
    plate.note(np.array([[before_m, nan]]))
    plate.departs()
    plate.arrives()
    plate.note(np.array([[one, nan] for one in read_m]).reshape(-1, 2))
    return plate


def test_the_tolerance_is_that_of_drive_and_sensor() -> None:
    assert pytest.approx(0.001 + RIG.plate.backlash_m + 0.0001) == TOLERANCE_M
    assert RIG.plate.backlash_m > 0.0


@pytest.mark.parametrize(
    ("read_m", "target_m", "stage_m", "more_m", "said"),
    [
        ((0.2,), 0.2, 0.2, 0.0, None),
        ((0.9, 0.2, nan), 0.2, 0.2, 0.0, None),
        ((0.2,), 0.2, 0.202, 0.001, None),
        ((1.0,), 1.0, 0.5, TO_HALF_M, None),
        ((LEAST_M - TOLERANCE_M,), LEAST_M, LEAST_M - TOLERANCE_M, 0.0, None),
        ((), 0.2, 0.2, 0.0, "brought no reading after the move to 0.2 m"),
        ((nan,), 0.2, 0.2, 0.0, "brought no reading after the move to 0.2 m"),
        ((LEAST_M - 0.002,), 0.06, 0.06, 9.0, "reads 0.0480 m .*, inside the least gap of 0.05 m"),
        (
            (0.6,),
            0.2,
            0.2,
            0.0,
            r"still reads 0.6000 m after the move to 0.2 m, tolerance 1\.\d mm",
        ),
        ((0.6,), 0.6, 0.7, 0.0, "reads 0.6000 m after the move to 0.6 m, the stage says 0.7000 m"),
        ((0.21,), 0.2, 0.2, 0.0, r"z_m reads 0.2100 m after the move to 0.2 m, tolerance 1\.\d mm"),
        ((0.61,), 0.2, 0.2, 0.02, r"still reads 0.6100 m .*, tolerance 21\.\d mm"),
    ],
)
def test_a_reading_after_a_move(
    read_m: tuple[float, ...], target_m: float, stage_m: float, more_m: float, said: str | None
) -> None:
    problem = moved(0.6, *read_m).problem(target_m, stage_m, more_m)
    if said is None:
        assert problem is None
    else:
        assert isinstance(problem, StageError)
        with pytest.raises(StageError, match=said):
            raise problem


def test_a_move_within_the_tolerance_is_not_called_frozen() -> None:
    problem = moved(0.5, 0.5).problem(1.0, 9.0, TO_HALF_M)
    assert problem is not None
    assert "still reads" not in str(problem)
    problem = moved(0.5, 1.0).problem(2.0, 2.0, TO_HALF_M)
    assert problem is not None
    assert "still reads" in str(problem)


@pytest.mark.parametrize(
    ("mean_m", "more_m", "said"),
    [
        (0.5, 0.0, None),
        (1.0, TO_HALF_M, None),
        (0.51, 0.0, r"moved while motors turned: .* 0\.5100 m .* 0\.5000 m, tolerance 1\.\d mm"),
        (0.6, 0.05, r"moved while motors turned: .*, tolerance 51\.\d mm"),
        (nan, 0.0, "brought no reading during the point at 0.5 m"),
    ],
)
def test_a_plate_that_moves_during_a_point(mean_m: float, more_m: float, said: str | None) -> None:
    problem = moved(0.5).crept(0.5, mean_m, more_m)
    assert (problem is None) == (said is None)
    if problem is not None:
        with pytest.raises(StageError, match=said):
            raise problem


def test_without_a_position_channel_nothing_is_judged() -> None:
    plate = PlateCheck(CHANNELS[1:], RIG)
    plate.note(np.array([[3.0]]))
    assert not plate.measured
    assert np.isnan(plate.read_m)
    assert plate.problem(0.2, 0.9) is None
    assert plate.crept(0.2, nan) is None


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
def test_where_a_plate_may_go(z_m: float, x_m: float, tilt_rad: float, said: str | None) -> None:
    if said is None:
        assert check_travel(RIG, z_m, x_m, tilt_rad) is None
    else:
        with pytest.raises(StageError, match=said):
            check_travel(RIG, z_m, x_m, tilt_rad)
