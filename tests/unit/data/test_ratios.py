"""T_IGE/T_OGE over references: ratios scatter with the covariance that they state."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchtool.core.recording import Recording
from benchtool.core.rig import Motor, Sensor
from benchtool.core.rig_file import load_rig_by_name
from benchtool.core.units import Array
from benchtool.data.columns import find_channel, word_to_code
from benchtool.data.run.ratios import (
    RATIO_BASES,
    VOLTAGE_POWER_SD,
    Ratios,
    ratios,
)

PULSES_US = (1450.0, 1600.0)
DISTANCES = 3
REPEATS = 2
SE = {"thrust_N": 0.002, "rpm1": 0.002, "voltage_V": 0.001, "current_A": 0.003}
"""Relative standard errors of every visit."""


def visits(pulses: tuple[float, ...] = PULSES_US, seed: int | None = None) -> Recording:
    """Return visits of a sweep with references in every repeat, with seeded errors or none."""
    rows = [
        (kind, repeat, pulse, near)
        for repeat in range(1, REPEATS + 1)
        for pulse in pulses
        for kind, near in [("reference", 0.0), *(("measure", float(i)) for i in range(DISTANCES))]
    ]
    kinds, repeats, pwm, near = (np.array(column) for column in zip(*rows, strict=True))
    # The near plate slows the rotor a little, and speed moves power by its cube.
    speed = 5.0 * (pwm - 1100.0) * (1.0 + 0.004 * near)
    gain = np.where(kinds == "measure", 1.3 - 0.1 * near, 1.0)
    columns = {
        "thrust_N": 1e-6 * speed**2 * gain,
        "rpm1": speed,
        "voltage_V": np.full(len(rows), 11.1),
        "current_A": 1e-9 * speed**3,
    }
    rng = np.random.default_rng(seed)
    errors = {name: SE[name] * values for name, values in columns.items()}
    if seed is not None:
        for name in columns:
            columns[name] = columns[name] + errors[name] * rng.standard_normal(len(rows))
    table = {
        "kind": np.array([word_to_code("kind", kind) for kind in kinds]),
        "repeat": repeats,
        "pwm1_us": pwm,
        **columns,
        "thrust_se_N": errors["thrust_N"],
        "rpm1_se": errors["rpm1"],
        "voltage_se_V": errors["voltage_V"],
        "current_se_A": errors["current_A"],
        "n_samples": np.full(len(rows), 100.0),
    }
    return Recording.from_columns(
        [(find_channel(name), np.asarray(values, float)) for name, values in table.items()]
    )


def covariance_of(found: Ratios) -> Array:
    whole = np.diag(found.standard_error**2)
    for source in found.error_sources:
        whole += source.columns @ source.columns.T
    return np.asarray(whole)


@pytest.mark.parametrize("basis", RATIO_BASES)
@pytest.mark.parametrize("pulses", [PULSES_US, PULSES_US[:1]], ids=["two pulses", "one pulse"])
def test_ratios_scatter_as_their_covariance_says(basis, pulses):
    exact = ratios(visits(pulses), basis)
    near = np.flatnonzero(visits(pulses).column("kind") == word_to_code("kind", "measure"))
    drawn = np.array([ratios(visits(pulses, seed), basis).value[near] for seed in range(1500)])
    # The exponent of one power is not fitted and does not scatter; its error is a guess.
    own = replace(exact, error_sources=exact.error_sources[:1])
    stated, found = covariance_of(own)[np.ix_(near, near)], np.cov(drawn, rowvar=False)
    scale = np.sqrt(np.outer(np.diag(stated), np.diag(stated)))
    np.testing.assert_allclose(found / scale, stated / scale, atol=0.11)
    assert np.abs(stated / scale - np.eye(len(near))).max() > 0.3
    bias = (drawn.mean(axis=0) - exact.value[near]) / np.sqrt(np.diag(stated))
    assert np.abs(bias).max() < 0.1


def test_each_reference_is_a_column_of_its_own_repeat():
    found = ratios(visits(), "equal_pwm")
    (reference,) = found.error_sources
    assert (reference.name, reference.kind, reference.scaled) == ("reference", "A", True)
    assert reference.columns.shape == (16, 4)
    np.testing.assert_array_equal((reference.columns != 0.0).sum(axis=1), 1)
    np.testing.assert_allclose(reference.columns[1:4, 0], -0.002 * found.value[1:4])
    np.testing.assert_allclose(found.total_error[1:4], 0.002 * 2**0.5 * found.value[1:4])


def test_sensors_of_the_rig_stand_in_for_errors_that_points_lack():
    points = visits()
    names = [name for name in points.names if not name.startswith(("voltage_se", "current_se"))]
    bare = Recording.from_columns(
        [(points.channels[points.index(name)], points.column(name)) for name in names]
    )
    rig = load_rig_by_name("pquad_single")
    without, having = ratios(bare, "equal_power"), ratios(bare, "equal_power", rig)
    assert np.all(having.standard_error > 1.005 * without.standard_error)
    # Rounding averages out where noise carries the reading over a step, and stays where not.
    assert Sensor(noise=0.0, quantum=0.12).mean_error(np.array([100.0])) == pytest.approx(
        0.12 / 12**0.5
    )
    assert Sensor(noise=0.1, quantum=0.01).mean_error(np.array([100.0])) < 0.0101


def test_a_pack_that_empties_is_no_ground_effect_at_equal_pulses():
    points = visits()
    sag = np.linspace(1.0, 0.98, len(points))
    columns = [(points.channels[i], points.column(name)) for i, name in enumerate(points.names)]
    changed = {"voltage_V": sag, "thrust_N": sag**2}
    sagging = Recording.from_columns(
        [(channel, values * changed.get(channel.name, 1.0)) for channel, values in columns]
    )
    rig = load_rig_by_name("pquad_single")
    truth, found = ratios(points, "equal_pwm").value, ratios(sagging, "equal_pwm", rig)
    np.testing.assert_allclose(found.value, truth, rtol=1e-12)
    assert np.abs(ratios(sagging, "equal_pwm").value / truth - 1.0).max() > 0.005
    _, exponent = found.error_sources
    assert (exponent.name, exponent.sd) == ("exponent of voltage", VOLTAGE_POWER_SD)
    lever = np.log(sag[1:4] / sag[0])
    expected = -found.value[1:4] * lever * VOLTAGE_POWER_SD
    np.testing.assert_allclose(exponent.columns[1:4, 0], expected, rtol=1e-9)
    # A controller that holds the speed leaves the voltage nothing to change.
    governed = replace(rig, motor=Motor(governed=True))
    assert len(ratios(sagging, "equal_pwm", governed).error_sources) == 1
