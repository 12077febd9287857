"""Thrust curves from logs of stands: constants that a log was made with, and measured logs."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import benchtool as bt
from benchtool.core.errors import InputError

HEAD = "Time (s),ESC signal (µs),Thrust (gf),Voltage (V),Current (A),Motor Electrical Speed (RPM)"
K, SLOPE, ZERO_US = 1.1e-6, 1.9, 900.0
GF_N = 9.80665e-3
DATA = os.environ.get("BENCHTOOL_REFERENCE_DATA")
measured = pytest.mark.skipif(DATA is None, reason="BENCHTOOL_REFERENCE_DATA is not set")


def log(path: Path, seed: int, noise: float = 0.01, sign: float = 1.0) -> Path:
    """Write a step log of a stand: T = k w^2, w = s (p - p0), voltage constant."""
    random = np.random.default_rng(seed)
    lines = [HEAD, "0,1000,0,11.1,0.02,0"]
    for place, pulse in enumerate(np.linspace(1100.0, 1900.0, 12)):
        speed = SLOPE * (pulse - ZERO_US) * (1.0 + 0.002 * random.standard_normal())
        thrust = sign * K * speed**2 * (1.0 + noise * random.standard_normal()) / GF_N
        rpm = speed * 30.0 / np.pi
        lines.append(f"{2 * place + 2},{pulse:.0f},{thrust:.3f},11.1,{thrust / 60:.3f},{rpm:.0f}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_constants_are_those_that_a_log_was_made_with(tmp_path: Path) -> None:
    held = dict.fromkeys(("k", "speed_per_us", "pulse_zero"), 0)
    truth = {"k": K, "speed_per_us": SLOPE, "pulse_zero": ZERO_US}
    for seed in range(40):
        found = bt.motor(log(tmp_path / f"{seed}.csv", seed), propeller="5x4").found
        for name in held:
            low, high = found[name].interval_95
            held[name] += low <= truth[name] <= high
        assert found.mass_kg is None
        assert not any(one.name.startswith("hover") for one in found.estimates)
    # At 95 %, 32 or fewer of 40 have a chance of 0.03 % each.
    assert {name: count for name, count in held.items() if count <= 32} == {}


def test_a_mass_gives_the_hover_point(tmp_path: Path) -> None:
    found = bt.motor(log(tmp_path / "a.csv", 1), propeller="5x4", mass_kg=0.1).found
    expected_rpm = np.sqrt(0.1 * 9.80665 / K) * 30.0 / np.pi
    assert found.value("hover_rpm") == pytest.approx(expected_rpm, rel=0.02)


def test_a_log_without_its_propeller_is_refused_with_what_to_add(tmp_path: Path) -> None:
    path = log(tmp_path / "a.csv", 1)
    with pytest.raises(InputError, match=r"--propeller with its size in inches"):
        bt.motor(path)
    assert bt.motor(path, rig="pquad_single").found.rig.name == "pquad_single"


def test_thrust_of_the_wrong_sign_is_refused_with_what_to_type(tmp_path: Path) -> None:
    path = log(tmp_path / "a.csv", 1, sign=-1.0)
    with pytest.raises(InputError, match=r"import .*a.csv --flip thrust_N turns the sign"):
        bt.motor(path, propeller="5x4")


def test_a_log_is_exported_with_its_intervals_and_without_a_hover_point(tmp_path: Path) -> None:
    path = log(tmp_path / "a.csv", 1)
    (file,) = bt.export(path, "ardupilot", tmp_path / "a.param", propeller="5x4")
    text = file.read_text()
    assert "MOT_THST_EXPO," in text
    assert "motor test a.csv" in text
    assert "MOT_THST_HOVER," not in text
    assert "# MOT_THST_HOVER left out, measure it" in text


@measured
@pytest.mark.parametrize("name", ["b4_7", "d2_11", "e4_11", "h7_11"])
def test_the_curve_of_a_measured_log_is_that_of_a_parabola_by_hand(name: str) -> None:
    assert DATA is not None
    path = Path(DATA) / "rcbenchmark_1520" / f"{name}.csv"
    found = bt.motor(path, propeller="5x4").found
    table = np.genfromtxt(path, delimiter=",", skip_header=1, usecols=(1, 5, 6, 8))
    pulse, thrust_gf, voltage, rpm = table[(table[:, 3] > 0.0)].T
    p = found.rig.propulsion
    u = (pulse - p.pwm_start_us) / (p.pwm_max_us - p.pwm_start_us)
    exponent = 1.0 if found["voltage_exponent"].open else found.value("voltage_exponent")
    thrust = GF_N * thrust_gf * (np.nanmax(table[:, 2]) / voltage) ** (2.0 * exponent)
    both = np.linalg.lstsq(np.column_stack([u, u * u]), thrust, rcond=None)[0]
    assert found.value("T_max") == pytest.approx(both.sum(), rel=0.03)
    speed = rpm * np.pi / 30.0
    by_hand = np.linalg.lstsq(
        np.column_stack([speed**2, np.ones(len(u))]), thrust_gf * GF_N, rcond=None
    )
    assert found.value("k") == pytest.approx(by_hand[0][0], rel=0.05)
    # ArduPilot's own table of start values: 0.55 for 5-inch propellers, 0.65 for 10-inch ones.
    assert 0.4 < found.value("expo") < 0.9
