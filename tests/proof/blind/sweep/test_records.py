"""Records of blind plate sweeps: format, families, physics, sizes, determinism."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from tests.proof.blind.sweep.bench import Bench
from tests.proof.blind.sweep.gap import gap
from tests.proof.blind.sweep.ground import GroundLaw, covered_fraction
from tests.proof.blind.sweep.layouts import LAYOUTS, SINGLE
from tests.proof.blind.sweep.library import NAMED, departure, power_of, shares
from tests.proof.blind.sweep.outside import OUTSIDE
from tests.proof.blind.sweep.programme import HABITS, programme
from tests.proof.blind.sweep.readings import Columns, cell_N, driven, thrust_N
from tests.proof.blind.sweep.records import families, make_record
from tests.proof.blind.sweep.table import swept

SEEN_IN_SPEED = {"battery_sag"}
EACH_LAYOUT = pytest.mark.parametrize("layout", LAYOUTS.values(), ids=list(LAYOUTS))


@pytest.fixture(scope="module")
def null():
    return make_record(0, "none", excitation="rich", layout="quad")


def check_table(table: pd.DataFrame) -> None:
    """Assert what holds for each part of each record."""
    visits = table[table["kind"] != "tare"]
    told = [name for name in visits if name not in {"kind", "torque_Nm", "temperature_degC"}]
    assert np.isfinite(visits[told].to_numpy(float)).all()
    assert (np.diff(table["time_s"]) > 0.0).all()
    assert (visits["elapsed_s"] > 0.0).all()
    assert visits["point"].is_monotonic_increasing
    assert set(table["kind"]) <= {"measure", "reference", "tare"}
    assert (visits["kind"] == "reference").sum() >= 2
    assert visits["plate_z_m"].min() >= 0.06
    assert visits["rpm1"].between(2500.0, 7500.0).all()
    assert visits["voltage_V"].min() > 9.6
    assert (visits["thrust_se_N"] > 0.0).all()


# --- families ------------------------------------------------------------------------------


@pytest.mark.parametrize("excitation", ["rich", "poor"])
@pytest.mark.parametrize("family", families())
def test_every_family_runs_in_the_format(family, excitation):
    record = make_record(1, family, excitation=excitation)
    for table in (record.learn, record.check):
        check_table(table)
    assert list(record.learn) == list(record.check)
    truth = record.truth
    assert truth.kind == families()[family]
    assert len(truth.effects) == {"named": 1, "pair": 2}.get(truth.kind, 0)
    for effect in truth.effects:
        assert 2.0 <= abs(effect.size) <= 8.0
        assert NAMED[effect.name].value_in(truth.bench) == pytest.approx(effect.size, abs=1e-6)
        assert set(effect.parameters) == set(NAMED[effect.name].tolerances(LAYOUTS[truth.layout]))
    json.dumps(truth.keys())


def test_the_check_has_other_distances_levels_and_order(null):
    for name in ("plate_z_m", "pwm1_us", "plate_x_m"):
        learn, check = (set(table[name].dropna()) for table in (null.learn, null.check))
        assert len(learn & check) <= 3, name
    assert null.learn["plate_z_m"].iloc[8:40].round(2).tolist() != (
        null.check["plate_z_m"].iloc[8:40].round(2).tolist()
    )


@EACH_LAYOUT
def test_rich_sweeps_hold_what_tells_effects_apart(layout):
    table = make_record(2, "none", excitation="rich", layout=layout.name).learn
    visits = table[table["kind"] != "tare"]
    z_over_R = visits["plate_z_m"] / layout.radius_m
    assert visits["pwm1_us"].nunique() == 4
    assert z_over_R.min() < 0.66
    assert ((z_over_R > 6.0) & (z_over_R < 9.0)).any()
    assert (visits["plate_z_m"] == layout.park_m).sum() >= 21
    assert visits["plate_x_m"].abs().between(0.1, 0.35).any()
    assert visits["plate_x_m"].abs().between(0.5, 0.7).sum() >= 28
    assert (table["kind"] == "tare").sum() >= 3
    steps = np.sign(np.diff(visits[visits["setting"] > 0]["pwm1_us"]))
    assert min((steps > 0).sum(), (steps < 0).sum()) >= 40


@pytest.mark.parametrize("habit", range(len(HABITS)), ids=HABITS)
def test_poor_sweeps_lack_levels_or_distances(habit, rng):
    bench = Bench(layout=SINGLE)
    table = swept(bench, programme(rng, SINGLE, "poor", habit), rng).table
    check_table(table)
    assert not (table["kind"] == "tare").any()
    assert (table["plate_x_m"] == 0.0).all()
    near = table[table["plate_z_m"] < SINGLE.park_m]
    assert (table["pwm1_us"].nunique(), near["plate_z_m"].nunique()) == [(1, 4), (4, 1), (2, 2)][
        habit
    ]


# --- sizes ---------------------------------------------------------------------------------


def test_shares_are_those_of_the_power():
    assert shares(1.0) == pytest.approx({"share_1": 0.25, "share_2": 1 / 3, "share_3": 0.5})
    assert departure(1.0) == 0.0
    for value in (-0.2, -0.05, 0.1, 0.4):
        assert departure(power_of(value)) == pytest.approx(value, abs=1e-9)


# --- physics -------------------------------------------------------------------------------


@pytest.mark.parametrize("near", [-0.03, 0.03])
@pytest.mark.parametrize("softness", [0.78, 1.22])
def test_the_ground_law_is_a_few_per_cent_off_cheeseman_and_bennett(softness, near):
    """Of the increment, and less where the effective radius takes up what it can."""
    ratios = np.linspace(0.5, 3.0, 26)
    height = (ratios * 0.12)[None, :]
    law = GroundLaw(radius_m=0.12, softness=softness, near=near)
    ours = law.factor(height, np.ones_like(height), np.zeros(1), np.zeros(1))[0] - 1.0
    radii = np.linspace(0.9, 1.1, 401)[:, None]
    theirs = 1.0 / (1.0 - (radii / (4.0 * ratios)) ** 2) - 1.0
    off = np.max(np.abs(theirs / ours - 1.0), axis=1)
    assert 0.015 < off[200] < 0.07
    assert 0.005 < off.min() < 0.03


def test_the_hard_law_is_cheeseman_and_bennetts_exactly():
    height = np.array([[0.06, 0.12, 0.48]])
    ours = GroundLaw(radius_m=0.12).factor(height, np.ones((1, 3)), np.zeros(1), np.zeros(1))
    assert ours[0] == pytest.approx(1.0 / (1.0 - (0.12 / (4.0 * height[0])) ** 2))


def test_covered_fractions_are_areas():
    inside = np.array([-0.2, -0.12, 0.0, 0.0485, 0.12, 0.2])
    area = covered_fraction(np.zeros((1, 1)), 0.12, -inside, np.full(6, 1.2))[0]
    assert area == pytest.approx([0.0, 0.0, 0.5, 0.75, 1.0, 1.0], abs=1e-3)


def readings(bench: Bench, rng: np.random.Generator) -> tuple[Columns, np.ndarray, np.ndarray]:
    """Return rows, true force and reading of a rich sweep on a bench."""
    rows = Columns.of(programme(rng, bench.layout, "rich", 0))
    speed = driven(bench, rows).speed_rad_s
    force = thrust_N(bench, rows, speed, np.zeros(len(rows.z_m)))
    return rows, force, cell_N(bench, rows, force, speed)


@EACH_LAYOUT
def test_thrust_rises_towards_the_plate_and_with_the_pulse(layout, rng):
    rows, force, reading = readings(Bench(layout=layout), rng)
    assert np.array_equal(force, reading)
    top = rows.level_us == rows.level_us.max()
    over = top & (rows.x_m == 0.0)
    order = np.argsort(rows.z_m[over])
    assert (np.diff(force[over][order]) < 0.02 * layout.hover_N).all()
    ratio = force[over].max() / force[over].min()
    assert 1.15 < ratio < 1.6
    parked = rows.z_m == layout.park_m
    assert force[parked & top].mean() > 2.0 * force[parked & (rows.level_us < 1410.0)].mean() > 0.0
    assert (force[~rows.turning] == 0.0).all()


# --- gaps ----------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("family", OUTSIDE)
@EACH_LAYOUT
def test_an_outside_effect_leaves_a_gap_that_no_named_one_closes(family, seed, layout):
    """At least four times the noise on both parts, and at most 80 % closed by any one effect."""
    record = make_record(seed, family, excitation="rich", layout=layout.name)
    for part in record.parts:
        found = gap(part, record.truth)
        assert found.thrust > 4.0
        assert max(found.closed.values()) < 0.8


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("family", NAMED)
def test_a_full_named_effect_stands_above_the_noise_and_closes_its_own_gap(family, seed):
    record = make_record(seed, family, excitation="rich")
    found = gap(record.parts[1], record.truth)
    if family in SEEN_IN_SPEED:
        assert found.speed > 20.0
        assert found.thrust < 0.01
    else:
        assert found.thrust > 1.5
        assert found.closed[family] > 0.5
        assert found.closed[family] > max(found.closed.values()) - 0.1


def test_nothing_hidden_leaves_no_gap(null):
    found = gap(null.parts[1], null.truth)
    assert (found.thrust, found.speed) == pytest.approx((0.0, 0.0), abs=1e-3)


def test_the_noise_is_what_the_table_says(null):
    part = null.parts[0]
    true = cell_N(null.truth.bench, part.rows, part.force_N, part.drive.speed_rad_s)[part.kept]
    scores = (null.learn["thrust_N"] - true) / null.learn["thrust_se_N"]
    assert 0.85 < np.std(scores) < 1.2
