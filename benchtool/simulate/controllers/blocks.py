"""Blocks of control laws: limits, cascaded PID, disturbance observer, feedforward.

Integrals of the PID are stored as command parts (rad/s, rad/s2), not as summed errors: a change of
gains during a run leaves the command unchanged.

The disturbance observer is eq. (12) in momentum form: no acceleration has to be measured. Eq. (12)
as printed has no dynamics (its left side must be the estimate's time derivative) and needs M qdd.
With the momentum p = M qd in its place, for each of the six components,

    F_hat = L (p - z),    dz/dt = F_known + F_hat,

where F_known is the sum of all modelled forces: commanded force, gravity, Coriolis terms. Then
dF_hat/dt = L (F - F_hat): a first-order filter of the true disturbance. The paper's controller
uses the torque components.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from benchtool.physics.expression import Quantity, at_least, at_most, expression


@expression
def clip(value: Quantity, limit: Quantity) -> Quantity:
    """Return the value within [-limit, limit]."""
    return at_most(at_least(value, -limit), limit)


@expression
def limit_slew_rate(
    requested: Quantity, present: Quantity, rate_limit: Quantity, dt_s: Quantity
) -> Quantity:
    """Return `requested`, limited in its rate of change to `rate_limit` per second."""
    return present + clip(requested - present, rate_limit * dt_s)


@expression
def integrate_clamped(
    integral: Quantity, change_per_s: Quantity, limit: Quantity, dt_s: Quantity
) -> Quantity:
    """Return an integral after one period, clipped to its limit."""
    return clip(integral + change_per_s * dt_s, limit)


@expression
def anti_windup_rate(requested: Quantity, granted: Quantity, change_per_s: Quantity) -> Quantity:
    """Return the rate of change of an integral, or 0 while it would increase a saturation.

    Anti-windup by clamping: `requested` is the command of the law, `granted` the same after the
    limit. A change that reduces the saturation is always allowed.
    """
    outward = (requested - granted) * change_per_s
    return change_per_s * (1.0 - at_most(at_least(np.sign(outward), 0.0), 1.0))


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


@expression
def estimate_disturbance(
    momentum: Quantity, explained_momentum: Quantity, rate_per_s: Quantity
) -> Quantity:
    """Return the estimate L (p - z) of one component: N or N m."""
    return rate_per_s * (momentum - explained_momentum)


@expression
def next_explained_momentum(
    momentum: Quantity,
    explained_momentum: Quantity,
    modelled_force: Quantity,
    estimate: Quantity,
    enabled: Quantity,
    dt_s: Quantity,
) -> Quantity:
    """Return z after one period: the momentum explained by modelled force and estimate.

    Args:
        modelled_force: includes the commanded compensation: N or N m.
        estimate: from `estimate_disturbance`, with the same momentum: N or N m.
        enabled: 1 while the observer runs; 0 sets z = p, so that the estimate starts from zero.
    """
    return (
        enabled * (explained_momentum + (modelled_force + estimate) * dt_s)
        + (1.0 - enabled) * momentum
    )


@expression
def expected_factor(factor: Quantity, strength: Quantity) -> Quantity:
    """Return the factor to divide by: 1 + strength (f - 1); strength 0 is no feedforward.

    A strength below 1 represents a model that predicts only part of the effect.
    """
    return 1.0 + strength * (factor - 1.0)


@expression
def compensated_thrust(thrust_N: Quantity, factor: Quantity) -> Quantity:
    """Return the OGE thrust to command for a requested thrust in ground effect: N.

    Rotors cannot produce negative thrust, so it is clipped to 0.
    """
    return at_least(thrust_N, 0.0) / factor
