"""Rotor speeds along a sweep: predicted from earlier visits, load counted alike in two sweeps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchtool.data.columns import KINDS
from benchtool.data.run.read import read_points
from benchtool.explain.sweep.log import sweep_log
from benchtool.explain.sweep.power import FIRST_VISITS, Power
from benchtool.physics.model_file import load_model

QUAD = Path(__file__).parents[3] / "datasets" / "quad" / "run"


@pytest.fixture(scope="module")
def power() -> Power:
    found = sweep_log(read_points(QUAD, KINDS), load_model("quad").model.rig).power
    assert found is not None
    return found


def sagging(power: Power) -> np.ndarray:
    """Return what a supply keeps that sags steadily (m, 1)."""
    return power.supply(np.array([1e-4]), np.array([0.0]), np.array([0.02]))


def test_speeds_of_a_supply_that_is_known_are_predicted_exactly(power: Power) -> None:
    drive = sagging(power)[None]
    scale = 1.0 + power.level
    read = np.broadcast_to(scale * drive[0, :, 0], power.rotor_rad_s.shape)[:, :, None]
    predicted = power.predicted(drive, read)
    assert predicted[:, power.late] == pytest.approx(read[:, power.late], rel=1e-12)
    assert not predicted[:, ~power.late].any()


def test_only_earlier_visits_predict(power: Power) -> None:
    drive = sagging(power)[None]
    read = power.rotor_rad_s[:, :, None].copy()
    before = power.predicted(drive, read)
    place = int(np.flatnonzero(power.late)[len(power.late) // 2])
    read[:, place] *= 1.5
    after = power.predicted(drive, read)
    changed = np.flatnonzero((before != after).any(axis=(0, 2)))
    assert len(changed) > 1
    assert changed.min() > place
    assert (power.level[changed] == power.level[place]).all()


def test_the_first_visits_of_a_level_are_not_judged(power: Power) -> None:
    for level in np.unique(power.level):
        rows = np.flatnonzero(power.level == level)
        assert not power.late[rows[:FIRST_VISITS]].any()
        assert power.late[rows[FIRST_VISITS:]].all()


def test_load_is_counted_as_in_the_other_sweep(power: Power) -> None:
    harder = replace(power, full_load=1.25 * power.full_load)
    same = power.loaded_as(harder)
    assert same.load == pytest.approx(power.load / 1.25)
    assert same.load * same.full_load == pytest.approx(power.load * power.full_load)


def test_current_is_not_counted_in_units_of_speed(power: Power) -> None:
    other = replace(power, by_current=not power.by_current, full_load=7.0)
    assert power.loaded_as(other) is power
