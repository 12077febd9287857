"""Attitude control by two nested loops, with the derivative on the measurement.

Integrals are stored as command parts (rad/s, rad/s2), not as summed errors: a change of gains
during a run leaves the command unchanged.
"""

from __future__ import annotations

from typing import NamedTuple

from benchtool.physics.expression import Quantity, expression
from benchtool.simulate.controllers.limits import anti_windup_rate, clip, integrate_clamped


class AttitudePid(NamedTuple):
    """Numbers of the attitude loop; fields as in `gain_file.AttitudeGains`.

    Attributes:
        torque_limit_Nm: limit of the mixer; infinite for none.
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
    """Integral parts of the rate command (rad/s) and of the acceleration (rad/s2)."""

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
    """Return the torque command of the two loops, before the limit: N m.

    tau = J (k_q (q_cmd - q) + I_q), q_cmd = k_theta e + I_theta. The rate enters as measured: a
    step of the reference gives no derivative kick. Assumed: the paper gives no law for its PID.
    """
    rate_command = attitude_rate_command(reference_rad, angle_rad, state, p)
    acceleration = p.k_q_per_s * (rate_command - rate_rad_s) + state.acceleration_rad_s2
    return p.inertia_kgm2 * acceleration


@expression
def attitude_rate_command(
    reference_rad: Quantity, angle_rad: Quantity, state: PidState, p: AttitudePid
) -> Quantity:
    """Return the rate command of the outer loop, within its limit: rad/s."""
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
    """Return the integrals after one control period; constant while the torque is at its limit."""
    requested_torque = attitude_torque(reference_rad, angle_rad, rate_rad_s, state, p)
    granted_torque = clip(requested_torque, p.torque_limit_Nm)
    error = reference_rad - angle_rad
    rate_error = attitude_rate_command(reference_rad, angle_rad, state, p) - rate_rad_s
    return PidState(
        integrate_clamped(
            state.rate_rad_s,
            anti_windup_rate(requested_torque, granted_torque, p.k_i_theta_per_s2 * error),
            p.theta_integral_limit_rad_s,
            dt_s,
        ),
        integrate_clamped(
            state.acceleration_rad_s2,
            anti_windup_rate(requested_torque, granted_torque, p.k_i_q_per_s2 * rate_error),
            p.q_integral_limit_rad_s2,
            dt_s,
        ),
    )
