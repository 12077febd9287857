"""Tables of the study of the paper, reproduced to the printed digits."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.rig_file import load_rig_by_name
from benchtool.physics.body_lift import WAKE_RULES
from benchtool.physics.images import partial_factor, rectangle_coverage
from benchtool.physics.rotor import pitch_moment_Nm
from tests.docs.examples import paper_script
from tests.unit.physics import paper_tables as tables
from tests.unit.physics.closed_forms import (
    quad_body_lift_factor,
    quad_factor,
    single_rotor_factor,
    three_rotor_average_factor,
    three_rotor_corner_factor,
    three_rotor_end_factor,
)
from tests.unit.physics.general_sum import multirotor_factors, pole_z_over_R
from tests.unit.physics.layouts import plus_layout
from tests.unit.physics.paper_tables import as_printed, rows

ATTITUDE = paper_script("attitude")
ROOT2 = np.sqrt(2.0)
GRAVITY = 9.81
PQUAD_R, AMUSE_R = 0.12, 0.205


def square(spacing: float) -> np.ndarray:
    """Return four rotors at the corners of a square (4, 2)."""
    h = 0.5 * spacing
    return np.array([[h, h], [-h, h], [-h, -h], [h, -h]])


def quads(radius: float, z: float, spacing: float) -> list[float]:
    """Return eq. (3), eq. (4) with b the diagonal, with half the diagonal."""
    return [
        quad_factor(radius, z, spacing),
        quad_body_lift_factor(radius, z, spacing, spacing * ROOT2, 2.0),
        quad_body_lift_factor(radius, z, spacing, spacing / ROOT2, 2.0),
    ]


def check_row(values: list[float], printed: list[str]) -> None:
    """Compare all values with the printed ones."""
    assert len(values) == len(printed)
    assert [as_printed(v, p) for v, p in zip(values, printed, strict=True)] == printed


@pytest.mark.parametrize("row", rows(tables.PQUAD), ids=lambda r: r[0])
def test_factors_of_pquad(row):
    z, d = float(row[0]) * PQUAD_R, 0.318
    three = [
        f(PQUAD_R, z, d)
        for f in (three_rotor_corner_factor, three_rotor_end_factor, three_rotor_average_factor)
    ]
    check_row([single_rotor_factor(PQUAD_R, z), *three, *quads(PQUAD_R, z, d)], row[1:])


@pytest.mark.parametrize("row", rows(tables.OTHER_SPACINGS), ids=lambda r: r[0])
def test_factors_at_other_spacings(row):
    z = float(row[0]) * PQUAD_R
    check_row([value for d in (0.27, 0.36, 0.40) for value in quads(PQUAD_R, z, d)], row[1:])


@pytest.mark.parametrize("row", rows(tables.THREE_ROTORS_036), ids=lambda r: r[0])
def test_factors_of_three_rotors(row):
    """Go by the general sum with the fourth rotor off; the closed forms are compared elsewhere."""
    height = float(row[0]) * PQUAD_R
    on = np.array([1.0, 1.0, 1.0, 0.0])
    ends_and_corner = multirotor_factors(PQUAD_R, height, on, square(0.36))
    values = [ends_and_corner[1], ends_and_corner[0], ends_and_corner[:3].mean()]
    check_row(values, row[1:])


@pytest.mark.parametrize("row", rows(tables.AMUSE), ids=lambda r: r[0])
def test_factors_of_amuse(row):
    z, d = float(row[0]) * AMUSE_R, 0.60
    angle = 0.25 * np.pi * np.arange(8)
    ring = 0.60 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    flat = multirotor_factors(AMUSE_R, z, np.ones(8), ring)
    assert np.ptp(flat) < 1e-12
    single = single_rotor_factor(AMUSE_R, z)
    three = three_rotor_average_factor(AMUSE_R, z, d)
    check_row([single, three, *quads(AMUSE_R, z, d), flat[0]], row[1:])


@pytest.mark.parametrize("row", rows(tables.POLES), ids=lambda r: f"d={r[1]}")
def test_poles_of_the_denominators(row):
    radius, d = float(row[0]), float(row[1])
    poles = [
        pole_z_over_R(radius, np.zeros((1, 2))),
        pole_z_over_R(radius, square(d)),
        pole_z_over_R(radius, square(d), 2.0, "diagonal"),
        pole_z_over_R(radius, square(d), 2.0, "half_diagonal"),
    ]
    check_row(poles, row[2:])
    for k, pole in enumerate(poles[1:]):
        assert quads(radius, (1.0 + 1e-9) * pole * radius, d)[k] > 1e6
        assert quads(radius, (1.0 - 1e-9) * pole * radius, d)[k] < -1e6
        above = np.linspace(1.001 * pole, 20.0, 5000) * radius
        assert np.all(quads(radius, above, d)[k] > 1.0), "one single zero, none above it"
    assert poles[0] == pytest.approx(0.25, rel=1e-15)


@pytest.mark.parametrize("row", rows(tables.WALL_MOMENT), ids=lambda r: f"z/R={r[0]} K_b={r[1]}")
def test_moment_at_the_edge_of_an_obstacle(row):
    layout = plus_layout(0.225)
    positions = np.stack([layout.x_m, layout.y_m], axis=1)
    centre = np.array(tables.WALL_X_M)
    coverage = np.array(
        [
            rectangle_coverage(centre + x, 0.0, PQUAD_R, 3.0, 5.0, -np.inf, np.inf)
            for x in layout.x_m
        ]
    )
    height = np.full(centre.size, float(row[0]) * PQUAD_R)
    weight = WAKE_RULES["notes"](coverage)
    factor = multirotor_factors(PQUAD_R, height, coverage, positions, float(row[1]), weight)
    thrust = 0.25 * 1.4 * GRAVITY * partial_factor(factor, coverage)
    backward = -1e3 * pitch_moment_Nm(thrust, layout.x_m)
    check_row([float(value) + 0.0 for value in np.abs(backward)], row[2:])
    assert np.all(backward > -1e-9)


def restoring_mNm(rig_name: str, z_over_R: float, tilt_deg: float, reading: str) -> float:
    """Return the moment against a nose-down tilt, for T = m g/4 of each disc."""
    tilts = np.radians([tilt_deg])
    found = ATTITUDE.restoring_moment_Nm(
        load_rig_by_name(rig_name), np.array([z_over_R]), tilts, reading
    )
    return float(1e3 * found[0, 0])


@pytest.mark.parametrize("row", rows(tables.RESTORING_PQUAD), ids=lambda r: r[0])
def test_restoring_moment_of_pquad(row):
    cases = [
        (2, "images"), (5, "images"), (10, "images"), (5, "images_diagonal"),
        (10, "images_diagonal"), (5, "rotors_only"), (10, "rotors_only"), (5, "vertical"),
        (10, "vertical"),
    ]  # fmt: skip
    check_row([restoring_mNm("pquad", float(row[0]), *case) for case in cases], row[1:])


@pytest.mark.parametrize("row", rows(tables.RESTORING_OWN_HEIGHT), ids=lambda r: r[0])
def test_restoring_moment_by_own_height(row):
    """The notes print this reading for T = m g/(4 cos(tilt))."""
    values = [
        restoring_mNm("pquad", float(row[0]), tilt, "own_height") / np.cos(np.radians(tilt))
        for tilt in (2, 5, 10)
    ]
    check_row(values, row[1:])


def test_moments_at_twice_the_radius_and_ten_degrees():
    """With either thrust: m g/4 of each rotor, and m g/(4 cos(tilt))."""
    for reading, printed in (
        ("images", ["19.2", "19.5"]),
        ("rotors_only", ["15.7", "16.0"]),
        ("vertical", ["14.4", "14.7"]),
        ("own_height", ["65.4", "66.4"]),
    ):
        moment = restoring_mNm("pquad", 2.0, 10.0, reading)
        check_row([moment, moment / np.cos(np.radians(10.0))], printed)


@pytest.mark.parametrize("row", rows(tables.RESTORING_AMUSE), ids=lambda r: r[0])
def test_restoring_moment_of_amuse(row):
    values = [restoring_mNm("amuse", float(row[0]), tilt, "images") for tilt in (5, 10)]
    check_row(values, row[1:])


def test_restoring_moment_of_amuse_by_rotors_only():
    values = [restoring_mNm("amuse", 2.0, tilt, "rotors_only") for tilt in (5, 10)]
    check_row(values, ["139", "286"])
    authority = 1e3 * ATTITUDE.hover_authority_Nm(load_rig_by_name("amuse"))
    check_row([100.0 * value / authority for value in values], ["0.5", "1.1"])


@pytest.mark.parametrize("row", rows(tables.AUTHORITY_PERCENT), ids=lambda r: r[0])
def test_restoring_moment_against_control_authority(row):
    authority = 1e3 * ATTITUDE.hover_authority_Nm(load_rig_by_name("pquad"))
    check_row([authority], ["1545"])
    for tilt, printed in zip((5, 10), row[1:], strict=True):
        if printed != "-":
            share = restoring_mNm("pquad", float(row[0]), tilt, "images") / authority
            check_row([100.0 * share], [printed])


@pytest.mark.parametrize(
    ("tilt_deg", "percent", "min_z"), [(5.0, 5.0, 1.01), (10.0, 5.0, 1.27), (10.0, 8.0, 1.12)]
)
def test_minimum_height_of_a_negligible_tilt(tilt_deg, percent, min_z):
    limit = 10.0 * percent * ATTITUDE.hover_authority_Nm(load_rig_by_name("pquad"))
    moments = [restoring_mNm("pquad", z, tilt_deg, "images") for z in (min_z - 0.01, min_z)]
    assert moments[0] > limit > moments[1]


def test_stiffness_of_the_restoring_moment():
    small = np.radians(0.01)
    moments = [restoring_mNm("pquad", 2.0, 0.01, name) for name in ("images", "rotors_only")]
    check_row([1e-3 * moment / small for moment in moments], ["0.108", "0.088"])


def test_moment_of_one_fully_covered_rotor():
    """Compare the pitch bench's M_s: one rotor over the plate at z/R = 2."""
    for radius, arm, mass, printed in ((PQUAD_R, 0.225, 1.4, "12.3"), (AMUSE_R, 0.45, 12.0, "210")):
        increment = single_rotor_factor(radius, 2.0 * radius) - 1.0
        check_row([1e3 * arm * 0.25 * mass * GRAVITY * increment], [printed])
