"""Built-in attitude law: two nested loops, an observer, and a law in pulse widths."""

from __future__ import annotations

from collections import namedtuple
from typing import Any, NamedTuple

from benchtool.physics.expression import expression
from benchtool.simulate.controllers.controller import ControlLaw, PitchCommand, PitchPlant
from benchtool.simulate.controllers.limits import clip
from benchtool.simulate.controllers.observer import estimate_disturbance, next_explained_momentum
from benchtool.simulate.controllers.pid import (
    AttitudePid,
    PidState,
    attitude_torque,
    next_pid_state,
)

# Gains of a PID in pulse widths, and the limit of its integral.
Pulses = namedtuple("Pulses", "kp_us_per_rad ki_us_per_rad_s kd_us_s_per_rad limit_rad_s")


class AttitudeNumbers(NamedTuple):
    """Numbers of the law; observer rate 0 (1/s) means no observer."""

    pid: AttitudePid
    observer_rate_per_s: Any
    pulses: Pulses


class AttitudeState(NamedTuple):
    """Integrals, momentum explained by the observer (N m s), summed error (rad s), and the last
    disturbance estimate (N m).
    """

    integrals: PidState = PidState(0.0, 0.0)
    explained_Nms: Any = 0.0
    error_rad_s: Any = 0.0
    estimate_Nm: Any = 0.0


@expression
def attitude_step(
    p: AttitudeNumbers, state: AttitudeState, measurement: Any, reference: Any, dt_s: Any
) -> tuple[AttitudeState, PitchCommand]:
    """Return state and command for the control period that begins now."""
    reference_rad, angle, rate = reference.theta_rad, measurement.theta_rad, measurement.rate_rad_s
    is_enabled, integrals = reference.observer, state.integrals
    momentum = p.pid.inertia_kgm2 * rate
    estimate = is_enabled * estimate_disturbance(
        momentum, state.explained_Nms, p.observer_rate_per_s
    )
    requested_Nm = attitude_torque(reference_rad, angle, rate, integrals, p.pid) - estimate
    torque = clip(requested_Nm, p.pid.torque_limit_Nm)
    next_integrals = next_pid_state(reference_rad, angle, rate, integrals, p.pid, dt_s)
    explained = next_explained_momentum(
        momentum, state.explained_Nms, torque, estimate, is_enabled, dt_s
    )
    error = reference_rad - angle
    summed_error = clip(state.error_rad_s + error * dt_s, p.pulses.limit_rad_s)
    difference = (
        p.pulses.kp_us_per_rad * error
        + p.pulses.ki_us_per_rad_s * summed_error
        - p.pulses.kd_us_s_per_rad * rate
    )
    return AttitudeState(next_integrals, explained, summed_error, estimate), PitchCommand(
        torque, difference
    )


def attitude_numbers(control: Any, plant: PitchPlant) -> AttitudeNumbers:
    """Return the law's numbers for gains, observer and pulse law of a `PitchControl`."""
    pid, rate_per_s, pulses = AttitudePid(*[0.0] * len(AttitudePid._fields)), 0.0, control.pulses
    if control.gains is not None:
        attitude = control.gains.attitude
        gains = {name: getattr(attitude, name) for name in attitude.__slots__}
        pid = AttitudePid(**gains, **plant._asdict())
        rate_per_s = control.gains.observer.rate_per_s if control.observer else 0.0
    return AttitudeNumbers(
        pid, rate_per_s, Pulses(*(getattr(pulses, name) for name in Pulses._fields))
    )


LAW = ControlLaw(
    name="pid",
    title="cascaded PID alone",
    step=attitude_step,
    state=AttitudeState(),
    numbers=attitude_numbers,
)
