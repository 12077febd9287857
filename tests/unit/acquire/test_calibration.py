from __future__ import annotations

import json
from dataclasses import asdict

import numpy as np
import pytest
from scipy.stats import binom

from benchtool.acquire.calibration import fit_calibration, with_drift_interval
from benchtool.acquire.inputs import MassUncertainty, WeighingInputs
from benchtool.core.air import Air, air_density_kg_m3
from benchtool.core.errors import CalibrationError, InputError, UnknownChoice
from benchtool.data.calibration import format_age_warning, format_traceability, parse_calibration

MASSES = np.array([0.0, 0.2, 0.5, 1.0, 1.5, 1.0, 0.5, 0.2, 0.0])
G = 9.81


def fitted(counts: np.ndarray, masses: np.ndarray = MASSES, days: tuple = (), **more: object):
    weighing = WeighingInputs(gravity=G, **more)
    return fit_calibration(
        masses, counts, date="2026-01-31", device_id="d", weighing=weighing, days=days
    )


def test_an_exact_line_comes_back():
    found = fitted(8000.0 + 420.0 * MASSES * G)
    assert found.slope_N_per_count == pytest.approx(1.0 / 420.0, rel=1e-12)
    assert found.offset_N == pytest.approx(-8000.0 / 420.0, rel=1e-12)
    assert found.straightness < 1e-12
    assert found.hysteresis == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(found.newtons(np.array([8420.0]), 8000.0), [1.0])


def test_the_lever_divides_the_force_at_the_rotor():
    found = fitted(420.0 * MASSES * G, lever_ratio=2.0)
    assert found.slope_N_per_count == pytest.approx(1.0 / 840.0, rel=1e-12)


def test_hysteresis_is_the_gap_between_up_and_down():
    counts = 420.0 * MASSES * G
    counts[5:] += 420.0 * 0.03
    found = fitted(counts)
    assert found.hysteresis == pytest.approx(0.03 / (1.5 * G), rel=0.01)
    one_way = fitted(420.0 * MASSES[:5] * G, MASSES[:5])
    assert one_way.hysteresis is None


@pytest.mark.parametrize(
    ("masses", "counts", "words"),
    [
        ([0.0, 1.0, 0.0], [0.0, 100.0, 0.0], "2 different masses"),
        ([0.0, 1.0, 2.0], [0.0, 1.0], "3 masses, but 2 readings"),
        ([0.0, -1.0, 2.0], [0.0, 1.0, 2.0], "mass -1 kg is out of range"),
        ([0.0, 1.0, np.nan], [0.0, 1.0, 2.0], "not finite"),
        ([0.0, 1.0, 2.0, 3.0], [7.0, 7.1, 6.9, 7.0], "is not significant"),
        ([0.0, 1.0, 2.0, 3.0], [0.0, 100.0, 200.0, 330.0], "% of full scale, limit 2 %"),
    ],
)
def test_nonsense_is_refused(masses, counts, words):
    with pytest.raises(CalibrationError, match=words):
        fitted(np.array(counts), np.array(masses))


def test_a_calibration_survives_json_and_refuses_strange_keys():
    rng = np.random.default_rng(1)
    found = fitted(8000.0 + 420.0 * MASSES * G + rng.normal(0.0, 5.0, len(MASSES)))
    data = json.loads(json.dumps(asdict(found)))
    assert parse_calibration(data, "c.json") == found
    with pytest.raises(UnknownChoice, match="slop"):
        parse_calibration({**data, "slop": 1.0}, "c.json")
    with pytest.raises(CalibrationError, match="slope is 0"):
        parse_calibration({**data, "slope_N_per_count": 0.0}, "c.json")


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
def test_density_of_moist_air(temperature_degC, pressure_Pa, humidity, density):
    found = air_density_kg_m3(temperature_degC, pressure_Pa, humidity)
    # A real gas is denser than the ideal one by about 4e-4 here.
    assert found == pytest.approx(density, rel=8e-4)


@pytest.mark.parametrize(
    "wrong", [{"temperature": 300.0}, {"pressure": 101325.0}, {"humidity": 145.0}]
)
def test_other_units_are_noticed(wrong):
    with pytest.raises(InputError, match="allowed is"):
        Air(**wrong)


TRIALS = 2000


def counted(days: int, sd_day: float = 0.0, known: MassUncertainty | None = None) -> np.ndarray:
    """Return how often the 68 % and the 95 % interval of the slope hold the truth.

    Five masses, up only, on each of so many days; a run is made on a day of its own.
    """
    rng = np.random.default_rng([22, days, int(1e6 * sd_day), known is not None])
    masses = np.array([0.0, 0.2, 0.5, 1.0, 1.5])
    held = np.zeros(2)
    for _ in range(TRIALS):
        own = masses * G
        if known:
            true = masses + (masses > 0.0) * known.mass_u_kg * rng.normal(size=5)
            true *= 1.0 + known.mass_scale_u * rng.normal()
            own = true * (G + known.gravity_u_m_s2 * rng.normal())
            own /= 1.0 + known.lever_u * rng.normal()
        gains = 420.0 * (1.0 + sd_day * rng.normal(size=days + 1))
        counts = [8000.0 + gain * own + rng.normal(0.0, 5.0, 5) for gain in gains[:days]]
        found = fitted(
            np.concatenate(counts),
            np.tile(masses, days),
            days=[str(day) for day in range(days) for _ in masses],
            uncertainty=known or MassUncertainty(),
        )
        off = abs(found.slope_N_per_count * gains[days] - 1.0)
        held += [off <= found.relative_half_width(p) for p in (0.6827, 0.95)]
    return held


@pytest.mark.parametrize(
    ("days", "sd_day", "known"),
    [
        (1, 0.0, None),
        (1, 0.0, MassUncertainty(mass_u_kg=1e-3)),
        (
            1,
            0.0,
            MassUncertainty(mass_u_kg=5e-4, mass_scale_u=1e-3, gravity_u_m_s2=0.01, lever_u=2e-3),
        ),
        (5, 3e-3, None),
        (3, 3e-3, None),
    ],
    ids=["five masses", "masses", "all that is stated", "five days", "three days"],
)
def test_intervals_of_the_slope_hold_the_truth(days, sd_day, known):
    """Counted over 2,000 calibrations; normal intervals of five masses hold it in 61 and 85 %."""
    for held, p in zip(counted(days, sd_day, known), (0.6827, 0.95), strict=True):
        low, high = binom.ppf([5e-4, 1.0 - 5e-4], TRIALS, p) / TRIALS
        # Sources of unlike degrees of freedom add by an approximation (GUM, G.4); the scatter of
        # days holds that of their readings, which the day of the run has not.
        room = 0.0 if known is None and days == 1 else 0.03
        assert low - min(room, 0.015) <= held / TRIALS <= high + room, (p, held / TRIALS)


def test_each_source_is_a_component():
    masses = np.array([0.0, 0.5, 1.0])
    day = 8000.0 + 420.0 * masses * G
    wobble = np.array([1.0, -2.0, 1.0])
    counts = np.concatenate([day + wobble, 1.002 * day + wobble, 1.001 * day + wobble])
    known = MassUncertainty(mass_u_kg=1e-3, mass_scale_u=2e-4, gravity_u_m_s2=0.003, lever_u=0.001)
    found = fitted(
        counts,
        np.tile(masses, 3),
        days=["a"] * 3 + ["b"] * 3 + ["c"] * 3,
        uncertainty=known,
        operator="Ada",
        certificate="DKD 17",
    )
    parts = {part.name: part for part in found.components}
    assert {name: (part.kind, part.unit, part.dof) for name, part in parts.items()} == {
        "repeat": ("A", "count", 3.0),
        "days": ("A", "1", 2.0),
        "masses": ("B", "kg", None),
        "scale of the masses": ("B", "1", None),
        "gravity": ("B", "m/s2", None),
        "lever": ("B", "1", None),
    }
    assert parts["gravity"].relative_sd == pytest.approx(0.003 / G)
    # (1 kg - 0 kg) of a centred line gives 1e-3 times the root of 1; the scatter shows its part.
    assert 0.5e-3 < parts["masses"].relative_sd < 1e-3
    assert parts["days"].relative_sd == pytest.approx(1e-3 * np.sqrt(4.0 / 3.0), rel=1e-2)
    assert found.relative_sd**2 == pytest.approx(sum(p.relative_sd**2 for p in parts.values()))
    one = parts["days"]
    spent = one.relative_sd**4 / 2.0
    assert found.dof == pytest.approx(found.relative_sd**4 / spent)
    data = json.loads(json.dumps(asdict(found)))
    assert parse_calibration(data, "c.json") == found
    assert format_traceability(data).endswith("by Ada on 2026-01-31, certificate DKD 17")


def test_days_need_masses_of_their_own_and_the_same_lever():
    counts = 8000.0 + 420.0 * MASSES * G
    with pytest.raises(CalibrationError, match="2 different masses on b"):
        fitted(counts, days=["a"] * 7 + ["b"] * 2)
    with pytest.raises(CalibrationError, match="9 readings, but 1 days"):
        fitted(counts, days=["a"])
    earlier = fitted(counts)
    other, same = WeighingInputs(gravity=G, lever_ratio=2.0), WeighingInputs(gravity=G)
    with pytest.raises(CalibrationError, match="lever ratio and gravity"):
        with_drift_interval(earlier, MASSES, counts, "2026-02-01", other)
    joined = with_drift_interval(earlier, MASSES, counts, "2026-02-01", same)
    again = fitted(joined[1], joined[0], days=joined[2])
    assert set(again.days) == {"2026-01-31", "2026-02-01"}
    assert again.slope_N_per_count == pytest.approx(earlier.slope_N_per_count)


@pytest.mark.parametrize(
    ("started", "valid_days", "said"),
    [
        ("2026-06-01T10:00:00+02:00", None, ""),
        ("2027-02-05T10:00:00", None, "was 370 days old when the run began, limit 365"),
        ("2026-06-01T10:00:00", 90.0, "was 121 days old when the run began, limit 90"),
        ("not stated", None, ""),
    ],
)
def test_the_age_of_a_calibration(started, valid_days, said):
    sensor = {} if valid_days is None else {"valid_days": valid_days}
    known = {"id": "c", "date": "2026-01-31T090000"}
    facts = {"started": started, "calibration": known, "rig": {"sensors": {"thrust_N": sensor}}}
    text = format_age_warning(facts)
    assert said in text
    assert bool(text) == bool(said)
    assert format_age_warning({**facts, "calibration": None}) == ""
