"""A recording of points becomes a sweep, or it is said what is missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchtool.core.errors import InputError
from benchtool.core.recording import Recording
from benchtool.core.rig_file import rig_named
from benchtool.data.columns import KINDS, channel_called
from benchtool.data.run.read import read_points
from benchtool.explain.sweep.log import sweep_log

RIG = rig_named("pquad")
QUAD = Path(__file__).parents[3] / "datasets" / "quad" / "run"


@pytest.fixture(scope="module")
def points() -> Recording:
    return read_points(QUAD, KINDS)


def only(recording: Recording, *names: str) -> Recording:
    """Return the recording with only those columns."""
    return Recording.from_columns(
        [(channel_called(name), recording.column(name)) for name in names]
    )


def test_tares_are_rows_without_a_plate_or_speed(points: Recording) -> None:
    log = sweep_log(points, RIG)
    assert log.tare.sum() == 2
    assert (log.conditions.speed_rad_s[:, log.tare] == 0.0).all()
    assert (log.conditions.plate_z_m[log.tare] > 1e5).all()
    assert not any("tare" in remark for remark in log.remarks)


def test_stays_end_where_the_plate_moves_or_the_cell_is_tared(points: Recording) -> None:
    log = sweep_log(points, RIG)
    places = log.conditions.plate_z_m
    assert (np.diff(log.stay) >= 0).all()
    for number in np.unique(log.stay):
        rows = log.stay == number
        assert np.ptp(places[rows]) < 1e-3
        assert len(set(log.tare[rows].tolist())) == 1


def test_rows_come_in_the_order_of_time(points: Recording) -> None:
    mixed = points.select(np.random.default_rng(1).permutation(len(points)))
    assert (np.diff(sweep_log(mixed, RIG).conditions.time_s) > 0.0).all()


def test_what_a_sweep_lacks_is_told(points: Recording) -> None:
    bare = only(points, "plate_z_m", "rpm1", "thrust_N")
    measured = bare.select(np.isfinite(bare.column("plate_z_m")))
    told = " ".join(sweep_log(measured, RIG, "bare.csv").remarks)
    assert "no standard errors of thrust: taken from the rig's load cell" in told
    assert "no rows of kind 'tare'" in told
    assert "no time_s: drift, hysteresis and battery sag cannot be judged" in told


def test_rows_with_empty_cells_are_left_out_and_counted(points: Recording) -> None:
    values = points.values.copy()
    values[5, points.index("thrust_N")] = np.nan
    log = sweep_log(Recording(points.channels, values), RIG)
    assert len(log) == len(points) - 1
    assert any(f"for an empty cell: 1 of {len(points)} rows" in remark for remark in log.remarks)


def test_points_without_thrust_are_refused(points: Recording) -> None:
    with pytest.raises(InputError, match=r"few\.csv has no thrust_N, only plate_z_m, rpm1"):
        sweep_log(only(points, "plate_z_m", "rpm1"), RIG, "few.csv")


def test_too_few_points_are_refused(points: Recording) -> None:
    with pytest.raises(InputError, match=r"has 3 whole points .* at least 4 are needed"):
        sweep_log(points.select(np.arange(1, 4)), RIG, "few.csv")


def test_speeds_at_given_pulses_are_kept_apart(points: Recording) -> None:
    power = sweep_log(points, RIG).power
    assert power is not None
    assert set(np.round(power.pulse_us)) == {1450.0, 1600.0}
    assert len(power.time_s) == len(points) - 2
    assert np.isfinite(power.voltage_V).all()
    assert 0.0 < power.late.mean() < 1.0
