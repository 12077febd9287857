"""What leaving out the hidden thing costs, and what the data can tell of it."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the blind bench is a MuJoCo model")

from tests.proof.blind.pitch.gap import gap, miss
from tests.proof.blind.pitch.information import NAMES, NOISE, information, surprise
from tests.proof.blind.pitch.loop import Part, closed_loop
from tests.proof.blind.pitch.outside import OUTSIDE
from tests.proof.blind.pitch.plant import Plant
from tests.proof.blind.pitch.programme import Programme
from tests.proof.blind.pitch.records import make_record
from tests.proof.blind.pitch.sheet import PARKED_M, SHEET

MATTERS = 1.25  # a gap this many times the floor, in one channel at least, is one that matters


def parked(
    collective_us: list[float],
    rng: np.random.Generator,
    seconds: float = 8.0,
    plant: Plant | None = None,
) -> Part:
    """Run a bench without a plate at these collectives, swinging a little."""
    n = round(seconds / SHEET.dt)
    t = np.arange(n) * SHEET.dt
    levels = np.array(collective_us)[np.arange(n) * len(collective_us) // n]
    swing = np.radians(5.0) * np.sin(2.0 * np.pi * 0.5 * t)
    return closed_loop(
        plant or Plant(), Programme(swing, levels, np.zeros(n), np.full(n, PARKED_M)), rng
    )


@pytest.mark.parametrize("family", OUTSIDE)
def test_what_no_library_names_matters(family):
    for seed in (10, 11):
        record = make_record(seed, family, excitation="rich")
        ratios = gap(record.parts[1], record.truth).ratio
        assert max(ratios.values()) > MATTERS, (seed, ratios)


def test_nothing_hidden_leaves_no_gap():
    record = make_record(12, "none", excitation="poor")
    assert set(gap(record.parts[0], record.truth).ratio.values()) == {1.0}


def test_a_hidden_effect_opens_a_gap():
    record = make_record(13, "rotor_asymmetry", excitation="rich")
    found = gap(record.parts[0], record.truth)
    assert found.ratio["theta"] > 5.0
    assert found.floor["rpm1"] == pytest.approx(NOISE[2], rel=0.03)


def test_the_floor_is_what_the_wake_makes_of_a_free_beam(rng):
    part = parked([1500.0], rng, seconds=60.0)
    floor = miss(part, Plant(), Plant())
    tau, sd = SHEET.tau_process, SHEET.sd_process / SHEET.J
    t = np.arange(250) * SHEET.dt
    # Rate: an integrated Ornstein-Uhlenbeck process.
    variance = 2.0 * sd**2 * tau * (t - tau * (1.0 - np.exp(-t / tau)))
    expected = math.sqrt(np.mean(variance) + NOISE[1] ** 2)
    assert floor["gyro"] == pytest.approx(expected, rel=0.25)


def test_the_true_model_is_surprised_as_it_should_be():
    record = make_record(14, "none", excitation="rich", dirt="clean")
    part, truth = record.parts[0], record.truth.plant
    assert surprise(part, truth) == pytest.approx(1.0, abs=0.03)


def test_a_wrong_model_is_surprised_by_what_the_information_says(rng):
    part = parked([1500.0], rng)
    # Off by two tolerances to one side and to the other; the noise's own share falls out.
    sides = [surprise(part, Plant(cog_x_m=x)) for x in (-0.001, 0.001)]
    more = (np.mean(sides) - surprise(part, Plant())) * 4 * len(part.states)
    k = NAMES.index("cog_offset")
    assert more == pytest.approx(4.0 * information(part, Plant()).matrix[k, k], rel=0.02)
