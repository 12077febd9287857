"""Speed and power of a motor under a changed rotor torque, at fixed pulse width or fixed power.

The torque at an effective voltage V is ((V - w/Kv)/Rm - I0)/Kv (Kv in rad/s per V). A fixed pulse
width therefore fixes Q + w/(Kv^2 Rm), the stall torque minus the torque of I0, without knowledge of
the voltage. Losses of the ESC are ignored.
"""

from __future__ import annotations

import numpy as np

from benchtool.core.rig import Motor, Propulsion
from benchtool.physics.expression import Quantity, expression

RPM = 30.0 / np.pi


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
