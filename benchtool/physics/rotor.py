"""Rotors: thrust, drag torque and speed of one (eq. 8, 10), wrench of several (eq. 9).

Axes: x forward, y left, z up. Positive roll torque lifts the left side, positive pitch torque is
nose down (eq. 9 with rotor 1 in front), positive yaw torque is counter-clockwise seen from above. A
rotor's spin is +1 counter-clockwise seen from above; its drag torque on the body is opposite.

The torque of a motor at an effective voltage V is ((V - w/Kv)/Rm - I0)/Kv (Kv in rad/s per V). A
fixed pulse width therefore fixes Q + w/(Kv^2 Rm), the stall torque minus the torque of I0, without
knowledge of the voltage. Losses of the ESC are ignored.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.rig import Motor, Propulsion
from benchtool.core.units import Array
from benchtool.physics.expression import Quantity, at_least, expression

WRENCH = ("thrust_N", "roll_Nm", "pitch_Nm", "yaw_Nm")  # rows: T, tau_phi, tau_theta, tau_psi

RPM = 30.0 / np.pi


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
    return slope_rad_s_us * (voltage_V / nominal_V) * at_least(pwm_us - start_us, 0.0)


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
    return np.sqrt(at_least(target_N, 0.0) / k_N_s2)


def torque_per_speed(motor: Motor | None) -> float | None:
    """Return 1/(Kv^2 Rm): N m s; None for a governed speed or without motor data."""
    if motor is None or motor.governed or motor.Kv_rpm_V is None or motor.resistance_ohm is None:
        return None
    return float((RPM / motor.Kv_rpm_V) ** 2 / motor.resistance_ohm)


@expression
def torque_at_pulse_Nm(
    speed_rad_s: Quantity, drag_Nm_s2: Quantity, slope_Nm_s: Quantity
) -> Quantity:
    """Return Q + w/(Kv^2 Rm) for Q = c w^2: N m; constant for a given pulse width.

    Args:
        drag_Nm_s2: c, near a plate times the torque ratio: N m s2.
        slope_Nm_s: 1/(Kv^2 Rm), `torque_per_speed`: N m s.
    """
    return (drag_Nm_s2 * speed_rad_s + slope_Nm_s) * speed_rad_s


@expression
def speed_under_pulse(torque_Nm: Quantity, drag_Nm_s2: Quantity, slope_Nm_s: Quantity) -> Quantity:
    """Return the speed for a value of `torque_at_pulse_Nm`, its inverse: rad/s."""
    root = np.sqrt(slope_Nm_s * slope_Nm_s + 4.0 * drag_Nm_s2 * torque_Nm)
    return 2.0 * torque_Nm / (slope_Nm_s + root)


@expression
def speed_near_plate(
    free_rad_s: Quantity, drag_Nm_s2: Quantity, factor: Quantity, slope_Nm_s: Quantity
) -> Quantity:
    """Return the speed at the pulse width that gives `free_rad_s` out of ground effect: rad/s."""
    torque_Nm = torque_at_pulse_Nm(free_rad_s, drag_Nm_s2, slope_Nm_s)
    return speed_under_pulse(torque_Nm, drag_Nm_s2 * factor, slope_Nm_s)


def electrical_power_W(
    propulsion: Propulsion, motor: Motor | None, speed_rad_s: Quantity, drag: Quantity = 1.0
) -> Quantity:
    """Return the electrical power of a running motor: (w/Kv + Rm I) I with I = I0 + Kv Q: W.

    Without motor data, the shaft power Q w over the efficiency.
    """
    torque_Nm = propulsion.drag_coefficient_Nm_s2 * drag * speed_rad_s * speed_rad_s
    if motor is None or motor.Kv_rpm_V is None or motor.resistance_ohm is None:
        return torque_Nm * speed_rad_s / propulsion.efficiency
    per_volt = motor.Kv_rpm_V / RPM
    current_A = motor.no_load_current_A + per_volt * torque_Nm
    return (speed_rad_s / per_volt + motor.resistance_ohm * current_A) * current_A


def mixer_matrix(
    x_m: Sequence[float] | Array,
    y_m: Sequence[float] | Array,
    spin: Sequence[float] | Array,
    k_N_s2: float,
    c_Nm_s2: float,
) -> Array:
    """Return the matrix (4, n) from squared speeds to `WRENCH` for rotors at (x, y) (eq. 9).

    Rows: k; k y; -k x; -c spin, with k and c of eq. (8).
    """
    x, y, spins = (np.asarray(value, float) for value in (x_m, y_m, spin))
    if not x.shape == y.shape == spins.shape or x.ndim != 1:
        raise InputError(
            f"the mixer needs one x, y and spin per rotor; got {x.size}, {y.size} and {spins.size} "
            f"values"
        )
    return np.array([np.full(x.size, k_N_s2), k_N_s2 * y, -k_N_s2 * x, -c_Nm_s2 * spins])


@expression
def pitch_moment_Nm(thrust_N: Quantity, x_m: Quantity) -> Quantity:
    """Return -sum x_i T_i over rotors (n, ...), positive nose down: N m.

    Ground effect under the front rotors alone makes it negative (nose up).
    """
    total = 0.0 * thrust_N[0]
    for i in range(len(x_m)):
        total = total - x_m[i] * thrust_N[i]
    return total
