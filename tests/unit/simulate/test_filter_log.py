"""Filtering a log with the very plant that made it leaves white innovations of the stated size."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.schedule import load_schedule
from benchtool.explain.pitch.filter import pitch_filter
from benchtool.physics.model import Model
from benchtool.physics.model_file import load_model
from benchtool.simulate.controllers.pitch import PitchControl
from benchtool.simulate.gain_file import load_gains
from benchtool.simulate.pitch.bench import PitchBench
from benchtool.simulate.pitch.filter_log import LoggedPitch, filter_log, predict_windows
from benchtool.simulate.pitch.run import PitchJob
from benchtool.simulate.pitch.simulate import simulate_pitch

RATE_HZ = 250.0


def logged_from(model: Model, seed: int) -> LoggedPitch:
    control = PitchControl(name="pid", gains=load_gains("s3"), rate_Hz=RATE_HZ)
    schedule = load_schedule("identify").sampled(RATE_HZ, model.rig.propulsion.radius_m)
    bench = PitchBench.from_model(model, pwm_quantum_us=1.0)
    run = simulate_pitch(PitchJob(bench, control), schedule, seed)
    return LoggedPitch(
        rate_Hz=RATE_HZ,
        pwm_us=run.pwm_us,
        plate_z_m=run.column("plate_z_m"),
        plate_share=run.column("plate_share"),
        theta_rad=run.column("theta_rad"),
        gyro_rad_s=run.column("gyro_rad_s"),
        speed_rad_s=run.speed_rad_s,
        mode=np.ones(len(run.log)),
    )


def whitened(model: Model, logged: LoggedPitch) -> tuple[np.ndarray, np.ndarray]:
    bench = PitchBench.from_model(model, plant_rate_Hz=1000.0)
    filter_ = pitch_filter(bench, RATE_HZ, gyro=True, speeds=True)
    found = filter_log([bench], logged, filter_.gains)
    innovation = np.array(
        [logged.theta_rad - found.theta_rad[:, 0], logged.gyro_rad_s - found.gyro_rad_s[:, 0]]
    )
    speeds = (logged.speed_rad_s - found.speed_rad_s[:, :, 0].T) / filter_.reading_sd["rpm"]
    return (filter_.whitener @ innovation)[:, 75:], speeds[:, 75:]


@pytest.fixture(scope="module")
def true_model():
    return load_model("pitch_beam").model.with_fixed("coulomb_friction.torque_Nm", 0.0)


def test_the_true_plant_leaves_white_noise_of_unit_size(true_model):
    pitch, speeds = whitened(true_model, logged_from(true_model, seed=4))
    n = pitch.shape[1]
    spread = 4.0 / np.sqrt(2.0 * n)
    np.testing.assert_allclose(pitch.std(axis=1), 1.0, atol=0.03)
    np.testing.assert_allclose(speeds.std(axis=1), 1.0, atol=0.03)
    assert np.all(np.abs(pitch.mean(axis=1)) < 4.0 / np.sqrt(n))
    for row in pitch:
        assert abs(np.mean(row[1:] * row[:-1])) < 0.03 + spread
    for row in speeds:  # a correction by a tenth leaves that much of a reading's noise
        assert abs(np.mean(row[1:] * row[:-1])) < 0.1


def test_windows_of_a_log_are_what_its_parts_are_alone(true_model):
    model = true_model.with_effect("transport_delay", delay_s=0.006)
    logged = logged_from(model, 3)
    benches = [
        PitchBench.from_model(model.with_fixed("k", k), plant_rate_Hz=500.0) for k in (1e-5, 1.1e-5)
    ]
    states = {start: np.full((5, 2), 0.01 * k) for k, start in ((1, 400), (2, 900))}
    for state in states.values():
        state[3:] = 600.0
    rows, lead = 60, 25
    found = predict_windows(benches, logged, states, rows, lead)
    for (start, state), run in zip(states.items(), found, strict=True):
        part = logged.between(start - lead, start + rows)
        (alone,) = predict_windows(benches, part, {lead: state}, rows, lead)
        np.testing.assert_array_equal(run.theta_rad, alone.theta_rad)
        np.testing.assert_array_equal(run.speed_rad_s, alone.speed_rad_s)
