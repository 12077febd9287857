"""Position over velocity over attitude: from a place to go to, to the pitch that goes there.

The cascade with which the paper's claims can be reproduced: a velocity limit, a small limited
integral, a limited pitch command. `pid` turns the pitch command into torque. One horizontal axis;
the other one is the same law on roll.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from benchtool.physics.expression import Quantity, expression
from benchtool.simulate.controllers.limits import integrated, limited, slewed


class PositionLoop(NamedTuple):
    """Hold the numbers of the position loop; fields as in `library.PositionGains`."""

    k_x_per_s: Quantity
    k_v_per_s: Quantity
    k_iv_per_s2: Quantity
    integral_limit_m_s2: Quantity
    slew_limit_m_s2: Quantity
    pitch_limit_rad: Quantity


@expression
def velocity_command(
    error_m: Quantity,
    present_m_s: Quantity,
    speed_limit_m_s: Quantity,
    p: PositionLoop,
    dt_s: Quantity,
) -> Quantity:
    """Return the next velocity command: k_x times the error, limited, slewed: m/s."""
    wanted = limited(p.k_x_per_s * error_m, speed_limit_m_s)
    return slewed(wanted, present_m_s, p.slew_limit_m_s2, dt_s)


@expression
def next_velocity_integral(
    velocity_error_m_s: Quantity, integral_m_s2: Quantity, p: PositionLoop, dt_s: Quantity
) -> Quantity:
    """Return the velocity integral one period on, held at its limit: m/s2."""
    return integrated(
        integral_m_s2, p.k_iv_per_s2 * velocity_error_m_s, p.integral_limit_m_s2, dt_s
    )


@expression
def acceleration_command(
    velocity_error_m_s: Quantity, integral_m_s2: Quantity, p: PositionLoop
) -> Quantity:
    """Return the horizontal acceleration to ask for: m/s2."""
    return p.k_v_per_s * velocity_error_m_s + integral_m_s2


@expression
def pitch_command(acceleration_m_s2: Quantity, gravity_m_s2: Quantity, p: PositionLoop) -> Quantity:
    """Return the pitch that gives an acceleration at hover, a/g, limited: rad, nose down."""
    return limited(acceleration_m_s2 / gravity_m_s2, p.pitch_limit_rad)


@expression
def climb_command(
    error_m: Quantity,
    velocity_m_s: Quantity,
    integral_m_s2: Quantity,
    k_z_per_s2: Quantity,
    k_vz_per_s: Quantity,
    limit_m_s2: Quantity,
) -> Quantity:
    """Return the vertical acceleration to ask for: a PD law plus its integral part: m/s2."""
    return limited(k_z_per_s2 * error_m - k_vz_per_s * velocity_m_s + integral_m_s2, limit_m_s2)


@expression
def lifting_thrust(
    climb_m_s2: Quantity, mass_kg: Quantity, gravity_m_s2: Quantity, cos_tilt: Quantity
) -> Quantity:
    """Return the total thrust for a vertical acceleration at a tilt: N."""
    return mass_kg * (gravity_m_s2 + climb_m_s2) / np.maximum(cos_tilt, 0.5)
