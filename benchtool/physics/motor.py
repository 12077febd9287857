"""What a motor's speed and power do when its rotor's torque changes: at a fixed pulse, at a power.

A motor at an effective voltage V gives the torque ((V - w/Kv)/Rm - I0)/Kv (Kv in rad/s per V). What
a pulse holds is therefore Q + w/(Kv^2 Rm), the torque with the rotor held still less that of I0: no
voltage needs to be known. The ESC's own losses are not in it.
"""

from __future__ import annotations

import numpy as np

from benchtool.core.rig import Motor, Propulsion
from benchtool.physics.expression import Quantity, expression

RPM = 30.0 / np.pi


def torque_per_speed(motor: Motor | None) -> float | None:
    """Return 1/(Kv^2 Rm): N m s; None where the speed is held or the motor is not known."""
    if motor is None or motor.governed or motor.Kv_rpm_V is None or motor.resistance_ohm is None:
        return None
    return float((RPM / motor.Kv_rpm_V) ** 2 / motor.resistance_ohm)


@expression
def torque_at_pulse_Nm(
    speed_rad_s: Quantity, drag_Nm_s2: Quantity, slope_Nm_s: Quantity
) -> Quantity:
    """Return Q + w/(Kv^2 Rm) for Q = c w^2: N m, the same at every speed under one pulse.

    Args:
        drag_Nm_s2: c, near a plate times the torque ratio there: N m s2.
        slope_Nm_s: 1/(Kv^2 Rm), `torque_per_speed`: N m s.
    """
    return (drag_Nm_s2 * speed_rad_s + slope_Nm_s) * speed_rad_s


@expression
def speed_under_pulse(held_Nm: Quantity, drag_Nm_s2: Quantity, slope_Nm_s: Quantity) -> Quantity:
    """Return the speed at which a pulse holds `held_Nm`, the inverse of that: rad/s."""
    root = np.sqrt(slope_Nm_s * slope_Nm_s + 4.0 * drag_Nm_s2 * held_Nm)
    return 2.0 * held_Nm / (slope_Nm_s + root)


@expression
def speed_near_plate(
    free_rad_s: Quantity, drag_Nm_s2: Quantity, factor: Quantity, slope_Nm_s: Quantity
) -> Quantity:
    """Return the speed under a pulse that gives `free_rad_s` far from any surface: rad/s.

    Args:
        factor: drag torque near the plate over that there, at equal speed.
        slope_Nm_s: 1/(Kv^2 Rm), `torque_per_speed`: N m s.
    """
    held_Nm = torque_at_pulse_Nm(free_rad_s, drag_Nm_s2, slope_Nm_s)
    return speed_under_pulse(held_Nm, drag_Nm_s2 * factor, slope_Nm_s)


def electrical_power_W(
    propulsion: Propulsion, motor: Motor | None, speed_rad_s: Quantity, drag: Quantity = 1.0
) -> Quantity:
    """Return the electrical power of a running motor: (w/Kv + Rm I) I with I = I0 + Kv Q: W.

    Of a motor that nobody has described it is the shaft's, Q w, over the stated efficiency.

    Args:
        drag: torque over that far from any surface, at equal speed.
    """
    torque_Nm = propulsion.drag_coefficient_Nm_s2 * drag * speed_rad_s * speed_rad_s
    if motor is None or motor.Kv_rpm_V is None or motor.resistance_ohm is None:
        return torque_Nm * speed_rad_s / propulsion.efficiency
    per_volt = motor.Kv_rpm_V / RPM
    current_A = motor.no_load_current_A + per_volt * torque_Nm
    return (speed_rad_s / per_volt + motor.resistance_ohm * current_A) * current_A
