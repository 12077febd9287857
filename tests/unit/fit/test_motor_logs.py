"""Thrust curves from logs of stands: constants that a log was made with, and measured logs."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import benchtool as bt
from benchtool.core.errors import InputError
from benchtool.fit.motor.constants import MotorFit
from tests.unit.commands.command_line import run

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


LOGS = (
    *(f"rcbenchmark_1520/{name}.csv" for name in (
        "a1_11", "a1_7", "b4_11", "b4_7", "c4_11", "d2_11",
        "e4_11", "g1_7", "h7_11", "i8_11", "k3_7",
    )),
    "rcbenchmark_1580/StepsTest_2020-05-22_102946.csv",
    "rcbenchmark_1580/StepsTest_2020-06-16_214537.csv",
    "rcbenchmark_1780/Run_0_Polar_2021-10-15_151643.csv",
    "rcbenchmark_1580/xNova-SR-steps-up.csv",
)  # fmt: skip


def measured_fit(name: str, folder: Path, **options: object) -> MotorFit:
    """Return the fit of a shared log, its thrust positive."""
    assert DATA is not None
    path = Path(DATA) / name
    if "xNova" in name:
        options_of_import = ("--flip", "thrust_N", "--out", folder / path.name)
        assert run("import", path, *options_of_import) == 0
        path = folder / path.name
    return bt.motor(path, propeller="5x4", **options).found  # type: ignore[arg-type]


@measured
@pytest.mark.parametrize("name", LOGS)
def test_the_law_of_a_measured_log_follows_its_levels(name: str, tmp_path: Path) -> None:
    found = measured_fit(name, tmp_path)
    law, p = found.law, found.points
    assert law is not None
    speed, thrust = p.speed_rad_s, p.thrust_N
    order = np.argsort(thrust)
    rising = np.maximum.accumulate(speed[order])
    for share in (0.3, 0.5, 0.7, 0.9):
        wanted_N = share * thrust.max()
        by_hand = np.interp(np.sqrt(wanted_N), np.sqrt(thrust[order]), rising)
        value, sd = law.speed_at(wanted_N)
        assert abs(value - by_hand) < max(3.0 * sd, 0.012 * by_hand)
        assert found.thrust_at_speed_N(value) == pytest.approx(wanted_N, rel=1e-6)
