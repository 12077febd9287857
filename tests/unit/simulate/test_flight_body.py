"""The free body: energy, momentum, the integrator's order, and the paper's own form of it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchtool.simulate.controllers.controller import GRAVITY_M_S2
from benchtool.simulate.flight.vehicle import (
    FreeBody,
    apply_impulse,
    drift,
    pitch_angle,
    rates_after_impulse,
    roll_angle,
    upward,
    yaw_angle,
)
from tests.unit.simulate import euler_lagrange
from tests.unit.simulate.euler_lagrange import from_euler, rotation_matrix

INERTIA = np.array([0.018, 0.025, 0.036])
MASS = 1.4


def step(state: np.ndarray, dt_s: float, torque: np.ndarray, lift_N: float) -> None:
    """Take a state (13,) one step on: drift, kick, drift."""
    body = drift(FreeBody(*state), 0.5 * dt_s)
    force = lift_N * np.array(upward(body)) / MASS - np.array([0.0, 0.0, GRAVITY_M_S2])
    velocity = np.array([body.vx_m_s, body.vy_m_s, body.vz_m_s]) + dt_s * force
    rates = rates_after_impulse(body, tuple(torque), tuple(INERTIA), dt_s)
    state[:] = drift(apply_impulse(body, tuple(velocity), rates, 0.0), 0.5 * dt_s)[:13]


def at_start(z_m: float, attitude: tuple[float, ...], *rates: float) -> np.ndarray:
    return np.array([0.0, 0.0, z_m, *rates[:3], *from_euler(*attitude), *rates[3:]])


def thrown() -> np.ndarray:
    return at_start(5.0, (0.3, -0.4, 1.0), 1.0, -0.5, 4.0, 2.0, -1.0, 6.0)


def test_a_thrown_body_keeps_energy_and_momentum():
    state = thrown()

    def energy() -> float:
        spin = 0.5 * float(INERTIA @ state[10:13] ** 2)
        return 0.5 * MASS * float(state[3:6] @ state[3:6]) + MASS * GRAVITY_M_S2 * state[2] + spin

    def turning() -> np.ndarray:
        return rotation_matrix(state[6:10]) @ (INERTIA * state[10:13])

    e, h, v = energy(), turning(), state[3:6].copy()
    for _ in range(5000):
        step(state, 0.001, np.zeros(3), 0.0)
    assert energy() == pytest.approx(e, rel=1e-10)
    assert np.linalg.norm(turning()) == pytest.approx(np.linalg.norm(h), rel=1e-10)
    np.testing.assert_allclose(turning(), h, rtol=0.0, atol=1e-5 * np.linalg.norm(h))
    np.testing.assert_allclose(state[3:6] - v, [0.0, 0.0, -5.0 * GRAVITY_M_S2], atol=1e-10)
    assert np.linalg.norm(state[6:10]) == pytest.approx(1.0, abs=1e-12)


def test_halving_the_step_quarters_the_error():
    def after(dt_s: float) -> np.ndarray:
        state = thrown()
        for k in range(round(1.0 / dt_s)):
            middle = (k + 0.5) * dt_s
            torque = 0.02 * np.array([np.sin(3.0 * middle), np.cos(2.0 * middle), 0.3])
            step(state, dt_s, torque, 14.0 + np.sin(middle))
        return state

    fine = after(1.0 / 3200)
    errors = [np.abs(after(dt) - fine).max() for dt in (0.01, 0.005, 0.0025)]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all((orders > 1.6) & (orders < 2.4)), orders


def quaternion_rates(y: np.ndarray, force: np.ndarray, torque: np.ndarray) -> np.ndarray:
    w, a, b, c = y[6:10]
    p, q, r = y[10:13]
    turned = 0.5 * np.array(
        [
            -a * p - b * q - c * r,
            w * p + b * r - c * q,
            w * q + c * p - a * r,
            w * r + a * q - b * p,
        ]
    )
    linear = rotation_matrix(y[6:10]) @ force / MASS - np.array([0.0, 0.0, GRAVITY_M_S2])
    angular = (torque - np.cross(y[10:13], INERTIA * y[10:13])) / INERTIA
    return np.concatenate([y[3:6], linear, turned, angular])


def test_the_papers_form_and_the_quaternion_fly_the_same_way():
    force, torque = np.array([0.1, -0.2, 15.0]), np.array([0.004, -0.003, 0.002])
    angles, rates = np.array([0.2, -0.3, 0.5]), np.array([0.4, 0.6, -0.8])
    body_rates = euler_lagrange.rate_matrix(angles[0], angles[1]) @ rates
    state = at_start(1.0, tuple(angles), 0.0, 0.0, 0.0, *body_rates)
    q, q_dot = np.concatenate([state[:3], angles]), np.concatenate([state[3:6], rates])

    def paper(_: float, y: np.ndarray) -> np.ndarray:
        qdd = euler_lagrange.acceleration(MASS, INERTIA, y[:6], y[6:], force, torque)
        return np.concatenate([y[6:], qdd])

    accuracy = {"rtol": 1e-12, "atol": 1e-13, "method": "DOP853"}
    lagrange = solve_ivp(paper, (0.0, 2.0), np.concatenate([q, q_dot]), **accuracy).y[:, -1]
    body = solve_ivp(
        lambda _, y: quaternion_rates(y, force, torque), (0.0, 2.0), state, **accuracy
    ).y[:, -1]
    np.testing.assert_allclose(lagrange[:3], body[:3], rtol=0.0, atol=1e-9)
    free = FreeBody(**dict(zip(("qw", "qx", "qy", "qz"), body[6:10], strict=True)))
    euler = [roll_angle(free), pitch_angle(free), yaw_angle(free)]
    np.testing.assert_allclose(lagrange[3:6], euler, atol=1e-9)
    rates_then = euler_lagrange.rate_matrix(lagrange[3], lagrange[4]) @ lagrange[9:]
    np.testing.assert_allclose(rates_then, body[10:13], rtol=0.0, atol=1e-9)
