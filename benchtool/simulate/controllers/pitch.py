"""Pitch controllers: settings, and the built-in attitude law.

The law has two nested loops, an observer, and a law in pulse widths.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from benchtool.core.errors import InputError
from benchtool.physics.expression import expression
from benchtool.simulate.controllers.blocks import (
    AttitudePid,
    PidState,
    attitude_torque,
    clip,
    estimate_disturbance,
    next_explained_momentum,
    next_pid_state,
)
from benchtool.simulate.controllers.controller import ControlLaw, PitchCommand, PitchPlant
from benchtool.simulate.gain_file import Gains


class PulseLaw(NamedTuple):
    """A PID written in pulse widths: us = kp e + ki int(e) - kd gyro."""

    kp_us_per_rad: float = 0.0
    ki_us_per_rad_s: float = 0.0
    kd_us_s_per_rad: float = 0.0
    limit_rad_s: float = 0.5


NO_PULSES = PulseLaw()


class AttitudeNumbers(NamedTuple):
    """Numbers of the law; observer rate 0 (1/s) means no observer."""

    pid: AttitudePid
    observer_rate_per_s: Any
    pulses: PulseLaw


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
    pid, rate_per_s = AttitudePid(*[0.0] * len(AttitudePid._fields)), 0.0
    if control.gains is not None:
        attitude = control.gains.attitude
        gains = {name: getattr(attitude, name) for name in attitude.__slots__}
        pid = AttitudePid(**gains, **plant._asdict())
        rate_per_s = control.gains.observer.rate_per_s if control.observer else 0.0
    return AttitudeNumbers(pid, rate_per_s, control.pulses)


LAW = ControlLaw(
    name="pid",
    title="cascaded PID alone",
    step=attitude_step,
    state=AttitudeState(),
    numbers=attitude_numbers,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Feedforward:
    """Settings of a feedforward.

    Attributes:
        strength: compensated share of the expected increment; 0 is none.
        height_error_m: error of its map, added to the true distance.
        late_s: delay of its map relative to the plate; negative is early.
    """

    strength: float = 0.0
    height_error_m: float = 0.0
    late_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PitchControl:
    """Controller of the pitch bench.

    Attributes:
        gains: gain set of the cascade; None means no cascade.
        rate_Hz: control rate; None means that of the gain set.
    """

    name: str
    gains: Gains | None
    observer: bool = False
    feedforward: Feedforward = Feedforward()
    pulses: PulseLaw = NO_PULSES
    rate_Hz: float | None = None
    law: ControlLaw = LAW

    @property
    def control_rate_Hz(self) -> float:
        """Control rate, of the gain set by default."""
        if self.rate_Hz is not None:
            return self.rate_Hz
        if self.gains is None:
            raise InputError(f"controller {self.name!r} has neither gains nor a rate; set rate_Hz")
        return self.gains.control_rate_Hz
