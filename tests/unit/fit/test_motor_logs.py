"""Thrust curves from logs of stands: constants that a log was made with, and measured logs."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
import pytest

import benchtool as bt
from benchtool.core.errors import InputError
from benchtool.fit.motor.constants import MotorFit
from benchtool.fit.motor.law import level_numbers
from tests.unit.commands.command_line import run

HEAD = "Time (s),ESC signal (µs),Thrust (gf),Voltage (V),Current (A),Motor Electrical Speed (RPM)"
K, SLOPE, ZERO_US, REFERENCE_RAD_S = 1.1e-6, 1.9, 900.0, 1000.0
GF_N = 9.80665e-3
DATA = os.environ.get("BENCHTOOL_REFERENCE_DATA")
measured = pytest.mark.skipif(DATA is None, reason="BENCHTOOL_REFERENCE_DATA is not set")


def log(
    path: Path,
    seed: int,
    noise: float = 0.01,
    sign: float = 1.0,
    n: float = 2.0,
    sag_V: float = 0.0,
) -> Path:
    """Write a step log of a stand: T = k w_r^2 (w / w_r)^n, w = s (p - p0), w goes with voltage."""
    random = np.random.default_rng(seed)
    lines = [HEAD, "0,1000,0,11.1,0.02,0"]
    for place, pulse in enumerate(np.linspace(1100.0, 1900.0, 12)):
        voltage = 11.1 - sag_V * (pulse - 1100.0) / 800.0
        speed = SLOPE * (pulse - ZERO_US) * (voltage / 11.1)
        speed *= 1.0 + 0.002 * random.standard_normal()
        exact = sign * K * REFERENCE_RAD_S**2 * (speed / REFERENCE_RAD_S) ** n
        thrust = exact * (1.0 + noise * random.standard_normal()) / GF_N
        rpm = speed * 30.0 / np.pi
        lines.append(
            f"{2 * place + 2},{pulse:.0f},{thrust:.3f},{voltage:.4f},{thrust / 60:.3f},{rpm:.0f}"
        )
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_constants_are_those_that_a_log_was_made_with(tmp_path):
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


def test_only_an_export_needs_the_propeller_of_a_log(tmp_path, capsys):
    path, out = log(tmp_path / "a.csv", 1, sag_V=2.0), tmp_path / "a.param"
    assert "names no propeller, which C_T and an export need" in bt.motor(path).summary()
    for status, propeller in ((2, ()), (0, ("--propeller", "5x4"))):
        assert run("export", path, "--to", "ardupilot", "--out", out, *propeller) == status
    assert re.search(r"(?s)--mass-kg.*refused.*EXPO: \S+ \(.*95 %", capsys.readouterr().out)
    assert "not the maximum of the battery" in out.read_text("utf-8")


def test_thrust_of_the_wrong_sign_is_refused_with_what_to_type(tmp_path):
    path = log(tmp_path / "a.csv", 1, sign=-1.0)
    with pytest.raises(InputError, match=r"import .*a.csv --flip thrust_N reverses the sign"):
        bt.motor(path, propeller="5x4")


def test_the_law_is_that_which_held_out_levels_support(tmp_path):
    held = dict.fromkeys(("n", "hover_rpm", "T_max"), 0)
    hover_N, reference_N = 1.0, K * REFERENCE_RAD_S**2
    hover_rad_s = REFERENCE_RAD_S * (hover_N / reference_N) ** (1.0 / 2.2)
    full_N = reference_N * (SLOPE * 1000.0 / REFERENCE_RAD_S) ** 2.2
    truth = {"n": 2.2, "hover_rpm": hover_rad_s * 30.0 / np.pi, "T_max": full_N}
    squares = 0
    for seed in range(20):
        square = bt.motor(log(tmp_path / f"s{seed}.csv", seed), propeller="5x4").found
        assert square.law is not None
        squares += square.law.name == "k w^2"
        found = bt.motor(
            log(tmp_path / f"{seed}.csv", seed, n=2.2), propeller="5x4", mass_kg=hover_N / 9.80665
        ).found
        assert found.law is not None
        assert found.law.name == "c w^n"
        for name in held:
            low, high = found[name].interval_95
            held[name] += low <= truth[name] <= high
    # At 95 %, 15 or fewer of 20 have a chance of 0.3 % each.
    assert {name: count for name, count in held.items() if count <= 15} == {}
    # One standard error of the difference: some one in six of square laws is taken for another.
    assert squares >= 13


def test_a_single_k_is_the_best_over_its_speeds_with_its_largest_error(tmp_path):
    found = bt.motor(log(tmp_path / "a.csv", 1, noise=0.0, n=2.3), propeller="5x4").found
    p = found.points
    used = p.thrust_N >= 0.1 * p.thrust_N.max()
    ratio = p.thrust_N[used] / p.speed_rad_s[used] ** 2
    by_hand = 2.0 * ratio.min() * ratio.max() / (ratio.min() + ratio.max())
    assert found.value("k") == pytest.approx(by_hand, rel=1e-3)
    half = (ratio.max() - ratio.min()) / (ratio.max() + ratio.min())
    assert found.value("k_error") == pytest.approx(half, rel=0.02)
    low, high = found["k"].interval_95
    assert low < ratio.min() < ratio.max() < high


def test_thrust_is_not_extrapolated_far_unless_requested(tmp_path):
    path = log(tmp_path / "a.csv", 1, noise=0.001, sag_V=2.0)
    far, asked = (
        bt.motor(path, propeller="5x4", extrapolate=extrapolate) for extrapolate in (False, True)
    )
    measured = far.found["T_measured"]
    assert measured.value == pytest.approx(far.found.points.thrust_N.max())
    # 11.1 V are 22 % beyond the 9.1 V at the longest pulse.
    assert np.isnan(far.found.full.voltage_V)
    assert far.found.value("T_max") == pytest.approx(measured.value, rel=0.02)
    assert asked.found.full.voltage_V == 11.1
    full = asked.found["T_max"]
    assert full.value == pytest.approx(K * (SLOPE * 1000.0) ** 2, abs=3.0 * full.sd)
    assert full.value > 1.3 * measured.value


LOGS = (
    *(f"rcbenchmark_1520/{name}.csv" for name in (
        "a1_11", "a1_7", "b4_11", "b4_7", "c4_11", "d2_11",
        "e4_11", "g1_7", "h7_11", "i8_11", "k3_7", "m8_11",
    )),
    "rcbenchmark_1580/StepsTest_2020-05-22_102946.csv",
    "rcbenchmark_1580/StepsTest_2020-06-16_214537.csv",
    "rcbenchmark_1580/StepsTest20230624_2023-06-24_190243.csv",
    "rcbenchmark_1580/xNova-SR-ramp.csv",
    "rcbenchmark_1580/xNova-SR-steps-up.csv",
    "rcbenchmark_1780/Run_0_Polar_2021-10-15_151643.csv",
)  # fmt: skip
PUSHERS = ("xNova", "m8_11")


def measured_fit(name: str, folder: Path) -> MotorFit:
    """Return the fit of a shared log, its thrust positive."""
    assert DATA is not None
    path = Path(DATA) / name
    if any(pusher in name for pusher in PUSHERS):
        assert run("import", path, "--flip", "thrust_N", "--out", folder / path.name) == 0
        path = folder / path.name
    return bt.motor(path, propeller="5x4").found


@measured
@pytest.mark.parametrize("name", LOGS)
def test_every_constant_of_a_measured_log_is_that_by_hand(name, tmp_path):
    found = measured_fit(name, tmp_path)
    p, own = found.points, found.rig.propulsion
    pulses = np.unique(p.pulse_us)
    means = [p.thrust_N[p.pulse_us == pulse].mean() for pulse in pulses]
    assert found.value("T_measured") == pytest.approx(max(means))
    # Thrust over throttle: a parabola through 0, thrust brought to the voltage of full throttle.
    power = 2.0
    if found.law is not None:
        speed, thrust = p.speed_rad_s, p.thrust_N
        # Thrust over speed: each law by its normal equations, errors in N alike.
        exponents = np.linspace(1.8, 2.5, 701) if found.law.name == "c w^n" else [2.0]
        columns = [np.ones(len(speed))] if found.law.name == "k w^2 + T_0" else []
        fits = []
        for n in exponents:
            design = np.column_stack([(speed / 1000.0) ** n, *columns])
            values = np.linalg.lstsq(design, thrust, rcond=None)[0]
            fits.append((float(np.sum((design @ values - thrust) ** 2)), n, design @ values))
        _, n, law_N = min(fits, key=lambda fit: fit[0])
        assert found.law.values[2] == pytest.approx(n, abs=0.04)
        assert found.thrust_at_speed_N(speed) == pytest.approx(law_N, abs=0.02 * thrust.max())
        power = found.law.values[2]
        level = level_numbers(p.pulse_us)
        rms = np.array([np.sqrt(np.mean(speed[level == i] ** 2)) for i in range(level.max() + 1)])
        mean = np.array([thrust[level == i].mean() for i in range(level.max() + 1)])
        used = mean >= 0.1 * mean.max()
        error = np.abs(found.value("k") * rms[used] ** 2 / mean[used] - 1.0).max()
        assert found.value("k_error") == pytest.approx(error)
        assert abs(np.log(found.value("k") / np.median(mean[used] / rms[used] ** 2))) < 1.2 * error
        q = 1.0 if found["voltage_exponent"].open else found.value("voltage_exponent")
        slope = (p.voltage_V / own.voltage_nominal_V) ** q
        line = np.column_stack([slope * p.pulse_us, -slope]) / speed[:, None]
        if np.isnan(p.speed_se_rad_s).all():
            a, b = np.linalg.lstsq(line, np.ones(len(speed)), rcond=None)[0]
            assert found.value("speed_per_us") == pytest.approx(a, rel=1e-4)
            assert found.value("pulse_zero") == pytest.approx(b / a, rel=1e-4)
        power *= q
    ratio = np.ones(len(p.pulse_us))
    if np.isfinite(found.full.voltage_V):
        ratio = (own.voltage_nominal_V / p.voltage_V) ** power
    u = (p.pulse_us - own.pwm_start_us) / (found.full.pulse_us - own.pwm_start_us)
    both = np.linalg.lstsq(np.column_stack([u, u * u]), p.thrust_N * ratio, rcond=None)[0]
    assert found.value("T_max") == pytest.approx(both.sum(), rel=0.03)
    assert found.value("expo") == pytest.approx(both[1] / both.sum(), abs=2.0 * found["expo"].sd)
