"""The built-in attitude law as a controller of the seam, for use outside of a compiled loop.

The same expressions as in the simulator's loop, one call per control period: what a bench program
would run, and a start for a law of one's own.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from benchtool.simulate.controllers.controller import PitchCommand, PitchMeasurement, PitchReference
from benchtool.simulate.controllers.limits import limited
from benchtool.simulate.controllers.observer import next_explained, observed
from benchtool.simulate.controllers.pid import (
    AttitudePid,
    PidState,
    attitude_torque,
    next_pid_state,
)
from benchtool.simulate.gain_file import Gains


@dataclass(slots=True)
class AttitudeController:
    """Hold level or a reference with two nested loops, and with the observer of eq. (12).

    Attributes:
        pid: numbers of the loops.
        observer_rate_per_s: L of the observer; 0 is none.
        state: integrals.
        explained_Nms: the observer's memory.
        estimate_Nm: disturbance torque as last observed.
    """

    pid: AttitudePid
    observer_rate_per_s: float = 0.0
    state: PidState = field(default_factory=lambda: PidState(0.0, 0.0))
    explained_Nms: float = 0.0
    estimate_Nm: float = 0.0

    @classmethod
    def of(
        cls, gains: Gains, inertia_kgm2: float, torque_limit_Nm: float, observer: bool = False
    ) -> AttitudeController:
        """Return the controller of a gain set for a body of this inertia."""
        attitude = gains.attitude
        numbers = {name: getattr(attitude, name) for name in attitude.__slots__}
        pid = AttitudePid(**numbers, inertia_kgm2=inertia_kgm2, torque_limit_Nm=torque_limit_Nm)
        return cls(pid, gains.observer.rate_per_s if observer else 0.0)

    def step(
        self, measurement: PitchMeasurement, reference: PitchReference, dt_s: float
    ) -> PitchCommand:
        on = float(self.observer_rate_per_s > 0.0)
        angle, rate = measurement.theta_rad, measurement.rate_rad_s
        momentum = self.pid.inertia_kgm2 * rate
        self.estimate_Nm = on * observed(momentum, self.explained_Nms, self.observer_rate_per_s)
        wanted = attitude_torque(reference.theta_rad, angle, rate, self.state, self.pid)
        torque = float(limited(wanted - self.estimate_Nm, self.pid.torque_limit_Nm))
        self.state = next_pid_state(reference.theta_rad, angle, rate, self.state, self.pid, dt_s)
        self.explained_Nms = next_explained(
            momentum, self.explained_Nms, torque, self.estimate_Nm, on, dt_s
        )
        return PitchCommand(torque)
