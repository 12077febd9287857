"""Motor constants: each law against numbers by hand, and the truth of a virtual bench."""

from __future__ import annotations

from dataclasses import replace
from math import exp, pi, sqrt
from pathlib import Path

import numpy as np
import pytest

from benchtool.acquire.inputs import SweepInputs
from benchtool.acquire.operator import Unattended
from benchtool.acquire.plan import read_plan
from benchtool.acquire.session import run_experiment
from benchtool.core.channel import Channel
from benchtool.core.recording import Recording
from benchtool.core.rig_file import load_rig_by_name
from benchtool.core.user_code import check_code_allowed
from benchtool.fit.motor.constants import fit_motor
from benchtool.fit.motor.law import step_responses
from benchtool.fit.motor.runs import _way
from benchtool.report.motor import motor_sentence

RIG = load_rig_by_name("pquad_single")
TRUTH = {
    "k": 1.02e-5,  # virtual_pquad_single
    "n": 2.0,
    "speed_per_us": 1.05,  # the rig's, at 11.1 V
    "pulse_zero": 1050.0,
    "voltage_exponent": 1.0,
    "T_max": 1.02e-5 * (1.05 * 900.0) ** 2,
    "expo": 1.0,  # T goes with u^2 from pwm_start_us on
    "hover_throttle": sqrt(0.35 * 9.80665 / (1.02e-5 * (1.05 * 900.0) ** 2)),
    "hover_thrust_share": 0.35 * 9.80665 / (1.02e-5 * (1.05 * 900.0) ** 2),
    "hover_rpm": sqrt(0.35 * 9.80665 / 1.02e-5) * 30.0 / pi,
    "lag_up": 0.05,
    "lag_down": 0.05,
}


def swept(name: str, seed: int, out: Path) -> Path:
    address = f"sim:pquad_single?truth=virtual_pquad_single&seed={seed}"
    given = SweepInputs(address=address, plan=read_plan(name), out=out, yes=True)
    run = run_experiment(given, Unattended(), check_code_allowed)
    assert run is not None
    return run.path


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("motor")
    return [swept(name, 1, folder / name) for name in ("steps", "response")]


@pytest.fixture(scope="module")
def fitted(runs):
    return fit_motor(runs, extrapolate=True)


@pytest.mark.parametrize("name", TRUTH)
def test_the_truth_of_a_virtual_bench_lies_in_the_interval(fitted, name):
    found, truth = fitted[name], TRUTH[name]
    low, high = found.interval_95
    # Three of its standard uncertainties: of twelve intervals of 95 % one fails in every second.
    assert abs(found.value - truth) < 3.0 * found.sd
    assert low < found.value < high
    assert found.sd < 0.03 * abs(truth)
    assert not found.open


def test_the_summary_has_only_the_time_constants_that_were_measured(fitted):
    ups = tuple(item for item in fitted.estimates if item.name != "lag_down")
    assert " ms up and " in motor_sentence(fitted)
    assert motor_sentence(replace(fitted, estimates=ups)).endswith(" ms up.")


def stepped(lag_s: float, delay_s: float, rpm: tuple[float, float]) -> Recording:
    """Return samples of a step up at 1 s and down at 2 s, exactly of first order."""
    time_s = np.arange(600) / 200.0
    speed = np.full(600, rpm[0])
    for begin_s, old, new in ((1.0, rpm[0], rpm[1]), (2.0, rpm[1], rpm[0])):
        late = time_s >= begin_s + delay_s
        speed[late] = new + (old - new) * np.exp(-(time_s[late] - begin_s - delay_s) / lag_s)
    pulse = np.where((time_s > 1.0) & (time_s <= 2.0), 1600.0, 1300.0)
    channels = (Channel("time_s", "s"), Channel("pwm1_us", "us"), Channel("rpm1", "rpm"))
    return Recording(channels, np.column_stack([time_s, pulse, speed]))


def test_the_lag_of_a_step_is_that_it_was_made_with():
    up, down = step_responses(stepped(0.08, 0.012, (2000.0, 5000.0)), RIG)
    assert (up.up, down.up) == (True, False)
    for step in (up, down):
        assert step.lag_s == pytest.approx(0.08, rel=1e-3)
        assert step.delay_s == pytest.approx(0.012, abs=1e-4)
    assert up.after_rad_s == pytest.approx(5000.0 * pi / 30.0, rel=1e-4)
    assert up.before_rad_s == pytest.approx(2000.0 * pi / 30.0)
    at_one_lag = np.interp(0.012 + 0.08, up.time_s, up.speed_rad_s) * 30.0 / pi
    assert at_one_lag == pytest.approx(5000.0 - 3000.0 * exp(-1.0), rel=1e-3)


def test_a_steps_sag_is_taken_out_of_its_lag():
    plain = stepped(0.08, 0.0, (2000.0, 5000.0))
    volts = np.where(plain.column("pwm1_us") > 1500.0, 10.9, 11.0)
    sagging = Recording(
        (*plain.channels, Channel("voltage_V", "V")), np.column_stack([plain.values, volts])
    )
    up, _ = step_responses(sagging, RIG)
    # The speed made for falls by 0.1 V of 11 V of 5000 rpm while the speed rises by 3000 rpm.
    by_hand = up.seen_lag_s * (1.0 + (0.1 / 11.0) * 5000.0 / 3000.0)
    assert up.lag_s == pytest.approx(by_hand, rel=1e-4)


def test_full_throttle_is_the_highest_measured_pulse_unless_requested(runs, fitted):
    assert _way(np.array([1.0, 2.0, 2.0, 1.5, 1.5, 3.0])).tolist() == [1, 1, 1, -1, -1, 1]
    found = fit_motor(runs)
    assert found.points.pulse_us.max() == found.full.pulse_us == 1770.0  # 80 % of 1050 to 1950 us
    exact_N = TRUTH["k"] * (1.05 * 720.0) ** 2
    assert found.value("T_max") == pytest.approx(exact_N, abs=3.0 * found["T_max"].sd)
    assert fitted.full.pulse_us == 1950.0
    speed_rad_s = np.linspace(300.0, 700.0, 5)
    assert found.thrust_at_speed_N(speed_rad_s) == pytest.approx(
        TRUTH["k"] * speed_rad_s**2, rel=5e-3
    )
    for result in (found, fitted):
        u = (1500.0 - 1050.0) / (result.full.pulse_us - 1050.0)
        exact_N = TRUTH["k"] * (1.05 * 450.0) ** 2
        assert result.thrust_at_throttle_N(u) == pytest.approx(exact_N, rel=5e-3)
