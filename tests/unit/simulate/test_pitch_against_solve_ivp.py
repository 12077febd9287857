"""The compiled loop against a separately written model, solved to rounding between ticks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchtool.core.schedule import SampledSchedule
from benchtool.simulate.pitch.bench import PitchBench
from benchtool.simulate.pitch.simulate import PitchRun, simulate_pitch
from tests.unit.simulate.pitching import STEADY_PLATE, SWAY, job, quiet_bench, sampled, soft

R_M, ARM_M, DIAGONAL_M, K_B = 0.12, 0.225, 0.45, 2.0
SIDE_M = ARM_M * np.sqrt(2.0)
K, TAU_S, J, MASS_KG = 1.035e-5, 0.05, 0.018, 1.4
SPRING, DAMPING, COG_M, G = 0.05, 0.004, 0.0004, 9.81


def independent(schedule: SampledSchedule) -> np.ndarray:
    """Return pitch at every tick (m,): an ODE with the pulses held between ticks."""
    hover_N = MASS_KG * G / 4.0
    speed0 = np.sqrt(hover_N / K)
    state = np.array([0.0, 0.0, speed0, speed0, speed0, speed0])
    x = np.array([ARM_M, 0.0, -ARM_M, 0.0])
    dt_s = 1.0 / schedule.rate_Hz
    out = np.empty(len(schedule))
    gap_m = 2.0 * R_M
    for tick, reference in enumerate(schedule.reference_rad):
        theta, rate = state[0], state[1]
        out[tick] = theta
        torque = J * 7.4 * (np.clip(2.9 * (reference - theta), -3.5, 3.5) - rate)
        wanted = hover_N - x / np.sum(x * x) * torque
        commanded = np.sqrt(wanted / K)

        def slope(_t: float, y: np.ndarray, commanded: np.ndarray = commanded) -> np.ndarray:
            thrust = K * y[2:] ** 2
            # Eq. (2) of the front rotor alone: one covered disc has no body term.
            height_m = gap_m - ARM_M * np.sin(y[0])
            thrust[0] /= 1.0 - np.cos(y[0]) * (R_M / (4.0 * height_m)) ** 2
            moment = -np.sum(x * thrust) - SPRING * y[0] - DAMPING * y[1]
            moment += MASS_KG * G * COG_M * np.cos(y[0])
            return np.concatenate([[y[1], moment / J], (commanded - y[2:]) / TAU_S])

        solved = solve_ivp(slope, (0.0, dt_s), state, method="DOP853", rtol=1e-12, atol=1e-14)
        state = solved.y[:, -1]
    return out


@pytest.fixture(scope="module")
def smooth_bench():
    return quiet_bench(
        "pquad",
        neighbour_images={"strength": 1.0},
        body_lift={"K_b": K_B},
        hinge_spring={"stiffness_Nm_per_rad": SPRING},
        viscous_friction={"damping_Nms": DAMPING},
        cog_offset={"x_m": COG_M},
    )


def run_at(bench: PitchBench, plant_Hz: float, schedule: SampledSchedule) -> PitchRun:
    return simulate_pitch(job(replace(bench, plant_rate_Hz=plant_Hz), soft()), schedule)


def test_it_agrees_within_a_microradian_over_ten_seconds(smooth_bench):
    schedule = sampled(10.0, rate_Hz=250.0, reference_deg=SWAY, plate=STEADY_PLATE)
    run = run_at(smooth_bench, 1000.0, schedule)
    theta = run.column("true_theta_rad")
    assert np.max(np.abs(theta)) > 0.03
    assert np.max(np.abs(theta - independent(schedule))) < 1e-6


def test_the_integration_converges_with_the_square_of_the_step(smooth_bench):
    schedule = sampled(4.0, rate_Hz=250.0, reference_deg=SWAY, plate=STEADY_PLATE)
    finest = run_at(smooth_bench, 64_000.0, schedule).column("true_theta_rad")
    errors = [
        np.max(np.abs(run_at(smooth_bench, rate, schedule).column("true_theta_rad") - finest))
        for rate in (500.0, 1000.0, 2000.0, 4000.0)
    ]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(orders > 1.9)
    assert np.all(orders < 2.1)
