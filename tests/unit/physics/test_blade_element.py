"""Blade-element momentum theory against worked values, closed-form slopes and annular inflow."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from benchtool.core.rig import Blade, Motor
from benchtool.physics.effects.blade_inflow import (
    inflow_at_equal_thrust,
    inflow_response,
    profile_share,
    thrust_at_equal_speed,
    thrust_coefficient,
    torque_at_equal_speed,
    torque_coefficient,
)
from benchtool.physics.rotor import speed_near_plate, torque_at_pulse_Nm, torque_per_speed
from tests.unit.physics.blades import BLADE, MOTOR
from tests.unit.physics.closed_forms import single_rotor_factor

DENSITY, RADIUS_M, VOLTAGE = 1.225, 0.12, 6.5
DISC_M2 = np.pi * RADIUS_M**2

# z/R, G of eq. (2), kappa, T at equal rpm, Q at equal rpm, T at equal shaft power, w and T at equal
# pulse; last the T at equal rpm with inflow solved per annulus
TABLE = [
    (0.5, 1.333333, 0.649519, 1.247530, 0.931187, 1.308256, 1.004956, 1.259925, 1.2371),
    (1.0, 1.066667, 0.907730, 1.059283, 0.992489, 1.064621, 1.000536, 1.060420, 1.0569),
    (2.0, 1.015873, 0.976654, 1.014631, 0.998671, 1.015531, 1.000095, 1.014823, 1.0140),
    (3.0, 1.006993, 0.989601, 1.006487, 0.999453, 1.006853, 1.000039, 1.006565, 1.0062),
]


def coefficients(kappa: float, blade: Blade = BLADE) -> tuple[float, float]:
    c_T = thrust_coefficient(blade.solidity, blade.lift_slope, blade.pitch_rad, kappa)
    return c_T, torque_coefficient(blade.solidity, blade.profile_drag, kappa, c_T)


def drag_Nm_s2(kappa: float) -> float:
    """Return Q / w^2 from the coefficient: N m s2."""
    return DENSITY * DISC_M2 * RADIUS_M**3 * coefficients(kappa)[1]


def speed_at_voltage(kappa: float) -> float:
    """Return the speed of equal motor and rotor torque at `VOLTAGE`, by bisection."""
    per_volt = MOTOR.Kv_rpm_V * np.pi / 30.0

    def excess_torque(w: float) -> float:
        current = (VOLTAGE - w / per_volt) / MOTOR.resistance_ohm - MOTOR.no_load_current_A
        return current / per_volt - drag_Nm_s2(kappa) * w * w

    return float(brentq(excess_torque, 1.0, VOLTAGE * per_volt, xtol=1e-12))


def test_a_free_rotor_has_the_worked_coefficients():
    c_T, c_Q = coefficients(1.0)
    assert (round(c_T, 6), round(c_Q, 6)) == (0.012489, 0.001362)
    assert round(inflow_response(BLADE), 4) == 0.9016
    assert speed_at_voltage(1.0) == pytest.approx(572.78, abs=0.005)


@pytest.mark.parametrize("row", TABLE, ids=lambda row: f"z/R {row[0]}")
def test_every_basis_gives_the_worked_ratio(row):
    z, G, kappa, thrust, torque, at_power, speed, at_pulse, _ = row
    law = single_rotor_factor(1.0, z)
    inflow = inflow_at_equal_thrust(law)
    m, share = inflow_response(BLADE), profile_share(BLADE)
    t, q = thrust_at_equal_speed(inflow, m), torque_at_equal_speed(inflow, m, share)
    slope = torque_per_speed(MOTOR)
    assert slope is not None
    free = speed_at_voltage(1.0)
    w = speed_near_plate(free, drag_Nm_s2(1.0), q, slope) / free
    ratios = [law, inflow, t, q, t * q ** (-2.0 / 3.0), w, t * w * w]
    expected = [G, kappa, thrust, torque, at_power, speed, at_pulse]
    np.testing.assert_allclose(ratios, expected, rtol=0.0, atol=5.1e-7)


@pytest.mark.parametrize("G", [1.02, 1.3333, 2.0, 5.0])
@pytest.mark.parametrize("m", [0.1, 0.9, 2.5])
def test_without_profile_drag_equal_shaft_power_is_the_law(G, m):
    kappa = inflow_at_equal_thrust(G)
    t, q = thrust_at_equal_speed(kappa, m), torque_at_equal_speed(kappa, m, 0.0)
    assert t * q ** (-2.0 / 3.0) == pytest.approx(G, rel=1e-13)


def test_the_speed_at_a_pulse_width_solves_the_motor_equation():
    """Only Kv^2 Rm is needed: the voltage and the no-load current cancel."""
    slope, kappa = torque_per_speed(MOTOR), 0.7
    assert slope is not None
    free = speed_at_voltage(1.0)
    factor = coefficients(kappa)[1] / coefficients(1.0)[1]
    w = speed_near_plate(free, drag_Nm_s2(1.0), factor, slope)
    assert w == pytest.approx(speed_at_voltage(kappa), rel=1e-10)
    torque_Nm = torque_at_pulse_Nm(w, drag_Nm_s2(kappa), slope)
    assert torque_Nm == pytest.approx(torque_at_pulse_Nm(free, drag_Nm_s2(1.0), slope), rel=1e-13)
    assert torque_per_speed(Motor(governed=True)) is None
    assert torque_per_speed(None) is None


def test_a_law_past_its_pole_stops_the_inflow():
    """A fit may try a radius there: thrust stays finite, at 1 + m times the free one."""
    for factor in (np.inf, -3.0):
        kappa = inflow_at_equal_thrust(np.float64(factor))
        assert kappa == 0.0
        assert thrust_at_equal_speed(kappa, 0.9) == pytest.approx(1.9, rel=1e-14)
