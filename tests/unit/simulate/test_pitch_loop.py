"""The pitch loop against closed forms: stick, slip, lag, delay, energy, quantum, noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchtool.core.schedule import Signal
from benchtool.simulate.controllers.pitch import PulseLaw
from benchtool.simulate.pitch.bench import PitchBench, PitchSensor
from benchtool.simulate.pitch.run import PitchLoop
from benchtool.simulate.pitch.simulate import simulate_pitch
from tests.unit.simulate.pitching import (
    STEADY_PLATE,
    SWAY,
    job,
    nobody,
    noisy_bench,
    quiet_bench,
    sampled,
    soft,
)

WEIGHT_N = 1.2 * 9.81


def test_below_the_friction_the_beam_does_not_move_at_all():
    """A weight 1 mm off gives 11.8 mN m; a hinge that holds 12 mN m stays exactly at level."""
    bench = quiet_bench(cog_offset={"x_m": 0.001}, coulomb_friction={"torque_Nm": 0.012})
    run = simulate_pitch(job(bench), sampled(2.0))
    assert np.all(run.column("true_theta_rad") == 0.0)
    assert np.all(run.column("true_rate_rad_s") == 0.0)


def test_above_the_friction_it_slips_with_what_is_left():
    """theta = (m g x - T) t^2 / 2 J while the cosine is 1 to a few parts in a thousand."""
    bench = quiet_bench(cog_offset={"x_m": 0.001}, coulomb_friction={"torque_Nm": 0.008})
    run = simulate_pitch(job(bench), sampled(1.0))
    expected = (WEIGHT_N * 0.001 - 0.008) / 0.03 * run.time_s**2 / 2.0
    np.testing.assert_allclose(run.column("true_theta_rad"), expected, atol=1e-4)


def test_friction_brings_a_spinning_beam_to_rest_in_the_right_time():
    """From rate q the beam stops after J q / T, at J q^2 / 2 T, and stays there."""
    bench = quiet_bench(coulomb_friction={"torque_Nm": 0.02})
    loop = PitchLoop([job(bench)], sampled(2.0), 0, [0])
    loop.view("hinge.rate_rad_s")[:] = 0.4
    loop.run()
    theta, rate = loop.log[:, 8, 0], loop.log[:, 9, 0]
    assert np.flatnonzero(rate == 0.0)[0] / 500.0 == pytest.approx(0.03 * 0.4 / 0.02, abs=0.003)
    assert theta[-1] == pytest.approx(0.03 * 0.4**2 / 0.04, rel=2e-3)
    assert np.ptp(theta[400:]) == 0.0


def test_a_free_beam_on_a_spring_keeps_its_energy_and_a_free_one_its_momentum():
    bench = quiet_bench(hinge_spring={"stiffness_Nm_per_rad": 0.5})
    loop = PitchLoop([job(bench)], sampled(60.0), 0, [0])
    loop.view("hinge.rate_rad_s")[:] = 0.5
    loop.run()
    theta, rate = loop.log[:, 8, 0], loop.log[:, 9, 0]
    energy = 0.5 * 0.03 * rate**2 + 0.5 * 0.5 * theta**2
    np.testing.assert_allclose(energy, energy[0], rtol=1e-5)
    free = PitchLoop([job(quiet_bench())], sampled(2.0), 0, [0])
    free.view("hinge.rate_rad_s")[:] = 0.1
    free.run()
    assert np.ptp(free.log[:, 9, 0]) < 1e-15


def test_the_end_stop_holds_and_is_counted():
    bench = replace(quiet_bench(cog_offset={"x_m": 0.01}), stop_rad=0.2)
    run = simulate_pitch(job(bench), sampled(3.0))
    assert run.column("true_theta_rad").max() == 0.2
    assert run.stopped_steps > 1000


@pytest.mark.parametrize("delay_s", [0.0, 0.0004, 0.0005, 0.0007, 0.003, 0.0237])
def test_lag_and_delay_follow_a_step_exactly(delay_s):
    """Rotor speed after a step is the lag's own exponential, however the delay falls."""
    bench = quiet_bench(motor_lag={"tau_s": 0.02}, transport_delay={"delay_s": delay_s})
    stepped = sampled(0.3, collective=(Signal(shape="step", level=0.44, from_s=0.1),))
    run = simulate_pitch(job(bench), stepped)
    before = np.sqrt(WEIGHT_N / 2.0 / bench.model.parameters["k"].value)
    t = run.time_s - 0.1 - delay_s
    expected = before + 0.2 * before * np.where(t > 0.0, 1.0 - np.exp(-t / 0.02), 0.0)
    np.testing.assert_allclose(run.speed_rad_s[0], expected, rtol=1e-9)


def test_a_noiseless_sensor_is_within_half_a_quantum_and_a_slow_one_holds():
    slow = PitchSensor(quantum=0.01, rate_Hz=50.0, bias=0.001)
    bench = replace(quiet_bench(), sensors={"theta_rad": slow})
    run = simulate_pitch(job(bench, soft()), sampled(2.0, reference_deg=SWAY))
    read, true = run.column("theta_rad"), run.column("true_theta_rad")
    fresh = np.arange(0, 1000, 10)
    assert np.max(np.abs(read[fresh] - true[fresh] - 0.001)) <= 0.005 + 1e-12
    assert np.all(np.diff(read.reshape(-1, 10), axis=1) == 0.0)


def test_a_late_sensor_shows_the_past():
    bench = replace(quiet_bench(), sensors={"theta_rad": PitchSensor(delay_s=0.01)})
    run = simulate_pitch(job(bench, soft()), sampled(2.0, reference_deg=SWAY))
    read, true = run.column("theta_rad"), run.column("true_theta_rad")
    np.testing.assert_array_equal(read[5:], true[:-5])


def test_noise_has_the_stated_size_and_wake_torque_its_own_spectrum():
    bench = noisy_bench("pitch_beam")
    run = simulate_pitch(job(replace(bench, inertia_kgm2=1e6)), sampled(60.0), seed=5)
    assert np.std(run.column("gyro_rad_s")) == pytest.approx(
        np.hypot(0.0017453, 0.0010647 / np.sqrt(12.0)), rel=0.03
    )
    heavy = PitchBench.from_model(
        bench.model.with_fixed("coulomb_friction.torque_Nm", 0.0), inertia_kgm2=1e3
    )
    rate = simulate_pitch(job(heavy), sampled(600.0), seed=6).column("true_rate_rad_s")
    torque = 1e3 * np.diff(rate) * 500.0
    assert np.std(torque) == pytest.approx(0.004, rel=0.05)
    assert np.corrcoef(torque[:-50], torque[50:])[0, 1] == pytest.approx(np.exp(-1.0), abs=0.06)


def test_the_factor_of_the_loop_is_the_model_s():
    """A clamped beam feels -x (f - 1) T of the covered rotor, eq. (2)."""
    bench = replace(quiet_bench("pquad", body_lift={"K_b": 2.0}), inertia_kgm2=1e3)
    run = simulate_pitch(job(bench), sampled(2.0, plate=STEADY_PLATE))
    torque = 1e3 * np.diff(run.column("true_rate_rad_s"))[-10:] * 500.0
    assert torque.mean() == pytest.approx(-0.225 * 1.4 * 9.81 / 4.0 * (64.0 / 63.0 - 1.0), rel=1e-4)
    assert torque.mean() == pytest.approx(-0.0123, abs=1e-4)


def test_a_pulse_law_is_a_pid_in_microseconds():
    control = replace(
        nobody(), pulses=PulseLaw(kp_us_per_rad=350.0, ki_us_per_rad_s=350.0, kd_us_s_per_rad=65.0)
    )
    held = replace(quiet_bench(), inertia_kgm2=1e9)
    run = simulate_pitch(
        job(held, control), sampled(1.0, reference_deg=(Signal(shape="step", level=5.0),))
    )
    error = np.radians(5.0)
    base = run.pwm_us.mean(axis=0)
    expected = 350.0 * error + 350.0 * error * (run.time_s + 0.002)
    np.testing.assert_allclose(run.pwm_us[0] - base, expected, rtol=1e-6)
