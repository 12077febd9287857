from __future__ import annotations

import json
from dataclasses import asdict

import numpy as np
import pytest

from benchtool.acquire.calibration import (
    calibration_from,
    fit_calibration,
)
from benchtool.core.air import Air, air_density_kg_m3
from benchtool.core.errors import CalibrationError, InputError, UnknownChoice

MASSES = np.array([0.0, 0.2, 0.5, 1.0, 1.5, 1.0, 0.5, 0.2, 0.0])
G = 9.81


def fitted(counts: np.ndarray, masses: np.ndarray = MASSES, **more: float):
    return fit_calibration(masses, counts, date="2026-01-31", device_id="d", gravity_m_s2=G, **more)


def test_an_exact_line_comes_back() -> None:
    found = fitted(8000.0 + 420.0 * MASSES * G)
    assert found.slope_N_per_count == pytest.approx(1.0 / 420.0, rel=1e-12)
    assert found.offset_N == pytest.approx(-8000.0 / 420.0, rel=1e-12)
    assert found.straightness < 1e-12
    assert found.hysteresis == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(found.newtons(np.array([8420.0]), 8000.0), [1.0])


def test_the_lever_divides_the_force_at_the_rotor() -> None:
    found = fitted(420.0 * MASSES * G, lever_ratio=2.0)
    assert found.slope_N_per_count == pytest.approx(1.0 / 840.0, rel=1e-12)


def test_the_covariance_is_the_scatter_of_repeated_calibrations() -> None:
    rng = np.random.default_rng(11)
    found = [
        fitted(8000.0 + 420.0 * MASSES * G + rng.normal(0.0, 5.0, len(MASSES))) for _ in range(500)
    ]
    slopes = np.array([[c.slope_N_per_count, c.offset_N] for c in found])
    stated = np.mean([c.covariance for c in found], axis=0)
    np.testing.assert_allclose(np.cov(slopes.T), stated, rtol=0.25)
    assert found[0].relative_sd == pytest.approx(
        np.sqrt(found[0].covariance[0][0]) / found[0].slope_N_per_count
    )


def test_hysteresis_is_the_gap_between_up_and_down() -> None:
    counts = 420.0 * MASSES * G
    counts[5:] += 420.0 * 0.03
    found = fitted(counts)
    assert found.hysteresis == pytest.approx(0.03 / (1.5 * G), rel=0.01)
    one_way = fitted(420.0 * MASSES[:5] * G, MASSES[:5])
    assert one_way.hysteresis is None


def test_a_cell_mounted_the_other_way_round_has_a_negative_slope() -> None:
    assert fitted(-420.0 * MASSES * G).slope_N_per_count < 0.0


@pytest.mark.parametrize(
    ("masses", "counts", "more", "words"),
    [
        ([0.0, 1.0, 0.0], [0.0, 100.0, 0.0], {}, "2 different masses"),
        ([0.0, 1.0, 2.0], [0.0, 1.0], {}, "3 masses, but 2 readings"),
        ([0.0, -1.0, 2.0], [0.0, 1.0, 2.0], {}, "-1 kg is none"),
        ([0.0, 1.0, np.nan], [0.0, 1.0, 2.0], {}, "no number"),
        ([0.0, 1.0, 2.0, 3.0], [7.0, 7.1, 6.9, 7.0], {}, "do not follow the masses"),
        ([0.0, 1.0, 2.0, 3.0], [0.0, 100.0, 200.0, 330.0], {}, "% of full scale, limit 2 %"),
        ([0.0, 1.0, 2.0], [0.0, 1.0, 2.0], {"lever_ratio": 0.0}, "lever ratio of 0"),
    ],
)
def test_nonsense_is_refused(masses, counts, more, words: str) -> None:
    with pytest.raises(CalibrationError, match=words):
        fitted(np.array(counts), np.array(masses), **more)


def test_gravity_is_that_of_the_earth() -> None:
    with pytest.raises(CalibrationError, match=r"9\.76 to 9\.84"):
        fit_calibration(MASSES, 420.0 * MASSES, date="x", device_id="d", gravity_m_s2=1.62)


def test_a_calibration_survives_json_and_refuses_strange_keys() -> None:
    rng = np.random.default_rng(1)
    found = fitted(8000.0 + 420.0 * MASSES * G + rng.normal(0.0, 5.0, len(MASSES)))
    data = json.loads(json.dumps(asdict(found)))
    assert calibration_from(data, "c.json") == found
    with pytest.raises(UnknownChoice, match="slop"):
        calibration_from({**data, "slop": 1.0}, "c.json")
    with pytest.raises(CalibrationError, match="slope of 0"):
        calibration_from({**data, "slope_N_per_count": 0.0}, "c.json")


@pytest.mark.parametrize(
    ("temperature_degC", "pressure_Pa", "humidity", "density"),
    [
        # Standard atmosphere (ISO 2533): 1.2250 for an ideal dry gas.
        (15.0, 101_325.0, 0.0, 1.2250),
        # Ideal mixture by hand: (p - 0.378 e)/(287.05 T), e = 0.5 * 2339 Pa (steam tables).
        (20.0, 101_325.0, 0.5, (101_325.0 - 0.378 * 0.5 * 2339.0) / (287.05 * 293.15)),
        (25.0, 95_000.0, 0.8, (95_000.0 - 0.378 * 0.8 * 3169.0) / (287.05 * 298.15)),
    ],
)
def test_density_of_moist_air(
    temperature_degC: float, pressure_Pa: float, humidity: float, density: float
) -> None:
    found = air_density_kg_m3(temperature_degC, pressure_Pa, humidity)
    # A real gas is denser than the ideal one by about 4e-4 here.
    assert found == pytest.approx(density, rel=8e-4)


@pytest.mark.parametrize(
    "wrong", [{"temperature": 300.0}, {"pressure": 101325.0}, {"humidity": 145.0}]
)
def test_other_units_are_noticed(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match="allowed is"):
        Air(**wrong)
