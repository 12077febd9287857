"""Attitude by two nested loops, with the derivative on the measurement.

Integrals hold what they command (rad/s, rad/s2), not the summed error: a change of gains during a
run leaves the command where it is.
"""

from __future__ import annotations

from typing import NamedTuple

from benchtool.physics.expression import Quantity, expression
from benchtool.simulate.controllers.limits import clip, integrate_clamped, unwrap_integral


class AttitudePid(NamedTuple):
    """Hold the numbers of the attitude loop; fields as in `library.AttitudeGains`.

    Attributes:
        inertia_kgm2: turns angular acceleration into torque.
        torque_limit_Nm: what the mixer can give; infinite without.
    """

    k_theta_per_s: Quantity
    k_i_theta_per_s2: Quantity
    theta_integral_limit_rad_s: Quantity
    rate_limit_rad_s: Quantity
    k_q_per_s: Quantity
    k_i_q_per_s2: Quantity
    q_integral_limit_rad_s2: Quantity
    inertia_kgm2: Quantity
    torque_limit_Nm: Quantity


class PidState(NamedTuple):
    """Hold the integral parts of the rate command (rad/s) and of the acceleration (rad/s2)."""

    rate_rad_s: Quantity
    acceleration_rad_s2: Quantity


@expression
def attitude_torque(
    reference_rad: Quantity,
    angle_rad: Quantity,
    rate_rad_s: Quantity,
    state: PidState,
    p: AttitudePid,
) -> Quantity:
    """Return the torque that the two loops ask for: N m, unlimited.

    tau = J (k_q (q_cmd - q) + I_q), q_cmd = k_theta e + I_theta. The rate enters as measured: a
    step of the reference gives no derivative kick. Assumed: the paper gives no law for its PID.
    """
    wanted_rate = attitude_rate_command(reference_rad, angle_rad, state, p)
    acceleration = p.k_q_per_s * (wanted_rate - rate_rad_s) + state.acceleration_rad_s2
    return p.inertia_kgm2 * acceleration


@expression
def attitude_rate_command(
    reference_rad: Quantity, angle_rad: Quantity, state: PidState, p: AttitudePid
) -> Quantity:
    """Return the rate that the outer loop asks for, within its limit: rad/s."""
    error = reference_rad - angle_rad
    return clip(p.k_theta_per_s * error + state.rate_rad_s, p.rate_limit_rad_s)


@expression
def next_pid_state(
    reference_rad: Quantity,
    angle_rad: Quantity,
    rate_rad_s: Quantity,
    state: PidState,
    p: AttitudePid,
    dt_s: Quantity,
) -> PidState:
    """Return the integrals one control period on; they stop while the torque is at its limit."""
    wanted = attitude_torque(reference_rad, angle_rad, rate_rad_s, state, p)
    granted = clip(wanted, p.torque_limit_Nm)
    error = reference_rad - angle_rad
    rate_error = attitude_rate_command(reference_rad, angle_rad, state, p) - rate_rad_s
    return PidState(
        integrate_clamped(
            state.rate_rad_s,
            unwrap_integral(wanted, granted, p.k_i_theta_per_s2 * error),
            p.theta_integral_limit_rad_s,
            dt_s,
        ),
        integrate_clamped(
            state.acceleration_rad_s2,
            unwrap_integral(wanted, granted, p.k_i_q_per_s2 * rate_error),
            p.q_integral_limit_rad_s2,
            dt_s,
        ),
    )
