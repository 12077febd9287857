"""The blind bench's physics against closed forms, and against another integrator."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

pytest.importorskip("mujoco", reason="the blind bench is a MuJoCo model")

import mujoco

from tests.proof.blind.pitch.beam import STEP_S, compiled, flex_frequency_Hz
from tests.proof.blind.pitch.dirt import dirty_bench
from tests.proof.blind.pitch.loop import wake_torque
from tests.proof.blind.pitch.moving import STEPS, Moving, State, ground_factor
from tests.proof.blind.pitch.plant import Plant
from tests.proof.blind.pitch.rotors import Rotors
from tests.proof.blind.pitch.sheet import PARKED_M, SHEET

STILL = [0.0] * STEPS

OFF = (SHEET.pwm0, SHEET.pwm0)
HOVER = (SHEET.base_pwm, SHEET.base_pwm)
HOVER_THRUST_N = SHEET.kT * 6000.0**2


def thrown(
    plant: Plant,
    *,
    theta_rad: float = 0.0,
    rate_rad_s: float = 0.0,
    arms_rad_s: float | None = None,
    pulses_us: tuple[float, float] = OFF,
    plate_m: float = PARKED_M,
    seconds: float = 1.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Let go of a beam with steady rotors and no wake; return angle and rate at each sample."""
    bench = Moving(plant)
    one, two = (g * (p - SHEET.pwm0) for g, p in zip(plant.rpm_per_us, pulses_us, strict=True))
    against = 0.0 if arms_rad_s is None else arms_rad_s - rate_rad_s
    start = State((theta_rad, 0.0), (rate_rad_s, against), (one, two), 0.0, rate_rad_s)
    bench.restore(start, [pulses_us], 0.0, SHEET.dt)
    angles, rates = [], []
    for k in range(round(seconds / SHEET.dt)):
        angles.append(bench.theta_rad)
        rates.append(bench.rate_rad_s)
        bench.advance(pulses_us, plate_m, STILL, k * SHEET.dt)
    return np.array(angles), np.array(rates)


def period_s(angles: np.ndarray) -> float:
    """Return the mean period between rising zero crossings."""
    k = np.flatnonzero((angles[:-1] < 0.0) & (angles[1:] >= 0.0))
    times = (k - angles[k] / (angles[k + 1] - angles[k])) * SHEET.dt
    return float(np.mean(np.diff(times)))


@pytest.mark.parametrize("flex_Nm_per_rad", [0.0, 50.0])
def test_masses_give_inertia_and_centre_of_gravity(flex_Nm_per_rad):
    plant = Plant(
        inertia_kgm2=0.0312, cog_x_m=0.003, cog_below_m=0.0004, flex_Nm_per_rad=flex_Nm_per_rad
    )
    model = compiled(plant)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    assert inertia[0, 0] == pytest.approx(plant.inertia_kgm2, rel=1e-6)
    if plant.flexible:
        arms = (1.0 - plant.flex_hub_share) * plant.inertia_kgm2
        assert inertia[1, 1] == pytest.approx(arms, rel=1e-6)
    assert data.subtree_com[1] == pytest.approx([0.003, 0.0, -0.0004], abs=1e-9)
    assert model.body_subtreemass[1] == pytest.approx(SHEET.m)


def test_a_spring_swings_the_beam_at_its_period():
    plant = Plant(stiffness_Nm_per_rad=0.16, cog_below_m=0.0003)
    angles, _ = thrown(plant, theta_rad=0.02, seconds=20.0)
    stiffness = 0.16 + SHEET.m * SHEET.g * 0.0003
    expected = 2.0 * math.pi * math.sqrt(SHEET.J / stiffness)
    assert period_s(angles) == pytest.approx(expected, rel=1e-4)
    assert angles[-2000:].max() == pytest.approx(0.02, rel=1e-3)


def test_viscous_friction_lets_the_rate_decay_exponentially():
    _, rates = thrown(Plant(damping_Nms=0.02), rate_rad_s=1.0, seconds=2.0)
    t = np.arange(len(rates)) * SHEET.dt
    assert rates[1:] == pytest.approx(np.exp(-t * 0.02 / SHEET.J)[1:], rel=2e-3)


@pytest.mark.parametrize("law", ["constraint", "smooth"])
def test_coulomb_friction_stops_the_beam_in_its_time(law):
    plant = Plant(friction_Nm=0.01, friction_law=law, friction_width_rad_s=0.005)
    _, rates = thrown(plant, rate_rad_s=0.3, seconds=1.5)
    t = np.arange(len(rates)) * SHEET.dt
    moving = (t > 0.0) & (t < 0.8)
    assert rates[moving] == pytest.approx(0.3 - 0.01 / SHEET.J * t[moving], abs=2e-3)
    assert np.abs(rates[t > 1.2]).max() < 1e-3


@pytest.mark.parametrize("law", ["constraint", "smooth"])
def test_coulomb_friction_holds_a_smaller_torque(law):
    plant = Plant(friction_Nm=0.01, friction_law=law, friction_width_rad_s=0.005, cog_x_m=0.0007)
    held = SHEET.m * SHEET.g * 0.0007
    _, rates = thrown(plant, seconds=1.0)
    creep = 5e-5 if law == "constraint" else 0.005 * math.atanh(held / 0.01)
    assert np.abs(rates[50:]).max() <= creep * 1.05


def test_rotors_in_motion_damp_the_beam():
    plant = Plant(aero_damping=3.0)
    _, rates = thrown(plant, rate_rad_s=0.5, pulses_us=HOVER, seconds=0.5)
    tip_m_s = 6000.0 * 2.0 * math.pi / 60.0 * SHEET.R
    decay = 3.0 * 2.0 * SHEET.L**2 * HOVER_THRUST_N / tip_m_s / SHEET.J
    t = np.arange(len(rates)) * SHEET.dt
    assert rates[1:] == pytest.approx(0.5 * np.exp(-decay * t)[1:], rel=2e-3)


def test_ground_effect_of_images_and_body():
    h = 0.1
    image = (SHEET.R / (4.0 * h)) ** 2
    assert ground_factor(h, Plant())[0] == pytest.approx(1.0 / (1.0 - image))
    body = 2.0 * SHEET.R**2 * h / (SHEET.b_body**2 + 4.0 * h**2) ** 1.5
    assert ground_factor(h, Plant(K_b=2.0))[0] == pytest.approx(1.0 / (1.0 - image - 2.0 * body))
    whole = ground_factor(h, Plant())[0]
    assert ground_factor(h, Plant(coverage_share=0.4))[0] == pytest.approx(1 + 0.4 * (whole - 1))
    assert ground_factor(0.03, Plant(K_b=2.0)) == (4.0, True)
    assert ground_factor(1e3, Plant(K_b=2.0))[0] == pytest.approx(1.0, abs=1e-6)


def speeds(plant: Plant, pulses: list[float]) -> np.ndarray:
    """Return rotor 1's speed at the end of each period, from rest at 1500 us."""
    rotors = Rotors(plant)
    rotors.rest(HOVER)
    out = []
    for k, pulse in enumerate(pulses):
        rotors.advance((pulse, pulse), k * SHEET.dt)
        out.append(rotors.speed_rpm[0])
    return np.array(out)


@pytest.mark.parametrize("delay_s", [0.0, 0.0007, 0.004, 0.0131])
def test_a_step_arrives_late_and_lags(delay_s):
    answered = speeds(Plant(delay_s=delay_s, tau_s=0.025), [1600.0] * 50)
    t = (np.arange(50) + 1) * SHEET.dt - delay_s
    expected = 7200.0 - 1200.0 * np.exp(-np.maximum(t, 0.0) / 0.025)
    assert answered == pytest.approx(expected, rel=1e-12)


def test_the_steady_speed_is_the_map_less_the_sag():
    plant = Plant(rpm_per_us=(12.03, 12.0), sag_per_s=0.002)
    answered = speeds(plant, [1500.0] * 2500)
    t = 2499 * SHEET.dt
    lagging = plant.tau_s * 0.002
    assert answered[-1] == pytest.approx(12.03 * 500.0 * (1.0 - 0.002 * t + lagging), rel=2e-5)


def test_hub_and_arms_swing_against_each_other():
    plant = Plant(flex_Nm_per_rad=60.0, flex_hub_share=0.4)
    angles, _ = thrown(plant, rate_rad_s=0.5, arms_rad_s=0.0, seconds=4.0)
    drift = 0.4 * 0.5 * np.arange(len(angles)) * SHEET.dt
    assert period_s(angles - drift) == pytest.approx(1.0 / flex_frequency_Hz(plant), rel=2e-3)
    assert (angles - drift)[-500:].mean() == pytest.approx(0.0, abs=1e-3)


def test_wake_torque_has_its_variance_and_memory(rng):
    wake = wake_torque(rng, 2_000_000, 0.004, 0.1)
    # 2000 s hold 10,000 correlation times; the variance is then good to 1.4 %.
    assert wake.std() == pytest.approx(0.004, rel=0.02)
    for lag_s in (0.05, 0.1, 0.2):
        n = round(lag_s / STEP_S)
        memory = np.mean(wake[n:] * wake[:-n]) / np.mean(wake**2)
        assert memory == pytest.approx(math.exp(-lag_s / 0.1), abs=0.04)
    starts = np.array([wake_torque(rng, 1, 0.004, 0.1)[0] for _ in range(4000)])
    assert starts.std() == pytest.approx(0.004, rel=0.05)


def derivative(t: float, state: np.ndarray, plant: Plant, drive: np.ndarray) -> list[float]:
    """Return the whole bench's equations of motion, written a second time."""
    theta, rate, one_rpm, two_rpm = state
    pulses = drive[min(max(int((t - plant.delay_s) / SHEET.dt + 1e-9), 0), len(drive) - 1)]
    if t < plant.delay_s:
        pulses = np.array(HOVER)
    out = []
    for speed, gain, pulse in zip((one_rpm, two_rpm), plant.rpm_per_us, pulses, strict=True):
        target = gain * (pulse - SHEET.pwm0)
        out.append((target - speed) / plant.tau_s)
    scale = SHEET.kT * 6000.0 ** (2.0 - plant.thrust_exponent)
    one, two = scale * one_rpm**plant.thrust_exponent, scale * two_rpm**plant.thrust_exponent
    two *= plant.thrust_ratio
    h = 0.15 + plant.plate_dz_m + SHEET.L * math.sin(theta)
    body = 2 * plant.K_b * SHEET.R**2 * h / (SHEET.b_body**2 + 4 * h * h) ** 1.5
    factor = 1.0 / (1.0 - plant.ge_rho * (SHEET.R / 4 / h) ** 2 - body)
    one *= 1.0 + plant.coverage_share * (factor - 1.0)
    to_tip = 2.0 * math.pi / 60.0 * SHEET.R
    one *= 1.0 - plant.aero_damping * SHEET.L * rate / (one_rpm * to_tip)
    two *= 1.0 + plant.aero_damping * SHEET.L * rate / (two_rpm * to_tip)
    torque = SHEET.L * (one - two) - plant.damping_Nms * rate - plant.stiffness_Nm_per_rad * theta
    torque -= plant.friction_Nm * math.tanh(rate / plant.friction_width_rad_s)
    weight = SHEET.m * SHEET.g
    torque -= weight * (plant.cog_x_m * math.cos(theta) + plant.cog_below_m * math.sin(theta))
    return [rate, torque / plant.inertia_kgm2, *out]


def test_the_whole_bench_agrees_with_another_integrator(rng):
    drawn = dirty_bench(rng)
    plant = Plant(
        **{
            **{name: getattr(drawn, name) for name in Plant.__slots__},
            "friction_law": "smooth",
            "friction_Nm": 0.008,
            "tau_rise_ratio": 1.0,
            "sag_per_s": 0.0,
            "K_b": 1.0,
            "aero_damping": 2.0,
            "delay_s": 0.0025,
        }
    )
    n = 125
    swing = np.round(25.0 * np.sin(2.0 * np.pi * np.arange(n) * SHEET.dt / 0.4))
    drive = np.stack([1500.0 + swing, 1505.0 - swing], axis=1)
    bench = Moving(plant)
    bench.rest(HOVER)
    ours = []
    for k in range(n):
        ours.append((bench.theta_rad, bench.rate_rad_s, *bench.speed_rpm))
        bench.advance((drive[k, 0], drive[k, 1]), 0.15, STILL, k * SHEET.dt)
    start = [0.0, 0.0, *(gain * 500.0 for gain in plant.rpm_per_us)]
    theirs = solve_ivp(
        derivative,
        (0.0, n * SHEET.dt),
        start,
        t_eval=np.arange(n) * SHEET.dt,
        args=(plant, drive),
        max_step=2e-4,
        rtol=1e-8,
        atol=1e-10,
    ).y.T
    off = np.abs(np.array(ours) - theirs).max(axis=0)
    moved = np.abs(theirs[:, :2]).max(axis=0)
    assert moved[0] > 0.05
    assert off[0] < 2e-3 * moved[0]
    assert off[1] < 5e-3 * moved[1]
    assert off[2:].max() < 1.0
