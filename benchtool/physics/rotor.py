"""Single rotor: thrust and drag torque against speed (eq. 8, 10), speed against pulse width."""

from __future__ import annotations

import numpy as np

from benchtool.physics.expression import Quantity, expression


@expression
def thrust_N(speed_rad_s: Quantity, k_N_s2: Quantity) -> Quantity:
    """Return T = k w^2 out of ground effect (eq. 8): N."""
    return k_N_s2 * speed_rad_s * speed_rad_s


@expression
def drag_torque_Nm(speed_rad_s: Quantity, c_Nm_s2: Quantity) -> Quantity:
    """Return Q = c w^2 (eq. 8), in the paper also near the plate: N m."""
    return c_Nm_s2 * speed_rad_s * speed_rad_s


@expression
def ground_effect_thrust_N(speed_rad_s: Quantity, k_N_s2: Quantity, factor: Quantity) -> Quantity:
    """Return T = k w^2 f_GE (eq. 10): N."""
    return k_N_s2 * speed_rad_s * speed_rad_s * factor


@expression
def speed_from_pwm(
    pwm_us: Quantity,
    slope_rad_s_us: Quantity,
    start_us: Quantity,
    voltage_V: Quantity,
    nominal_V: Quantity,
) -> Quantity:
    """Return the steady speed, slope (V / V_nominal) (pwm - start), 0 below the start: rad/s.

    Assumed: speed is linear in pulse width and proportional to battery voltage, as for a brushless
    motor with an open-loop ESC within its operating range.
    """
    return slope_rad_s_us * (voltage_V / nominal_V) * np.maximum(pwm_us - start_us, 0.0)


@expression
def pwm_from_speed(
    speed_rad_s: Quantity,
    slope_rad_s_us: Quantity,
    start_us: Quantity,
    voltage_V: Quantity,
    nominal_V: Quantity,
) -> Quantity:
    """Return the pulse width of a steady speed, the inverse of `speed_from_pwm`: us."""
    return start_us + speed_rad_s * nominal_V / (slope_rad_s_us * voltage_V)


@expression
def speed_from_thrust(target_N: Quantity, k_N_s2: Quantity) -> Quantity:
    """Return the speed for a thrust out of ground effect; 0 for negative thrust: rad/s."""
    return np.sqrt(np.maximum(target_N, 0.0) / k_N_s2)
