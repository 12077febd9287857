"""Controllers of the pitch bench as values: which laws act, with which numbers."""

from __future__ import annotations

from dataclasses import dataclass

from benchtool.core.errors import InputError
from benchtool.simulate.controllers import pitch_law
from benchtool.simulate.controllers.controller import ControlLaw
from benchtool.simulate.gain_file import Gains


@dataclass(frozen=True, slots=True, kw_only=True)
class PulseLaw:
    """A PID written in pulse widths: us = kp e + ki int(e) - kd gyro."""

    kp_us_per_rad: float = 0.0
    ki_us_per_rad_s: float = 0.0
    kd_us_s_per_rad: float = 0.0
    limit_rad_s: float = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Feedforward:
    """Say what a feedforward knows.

    Attributes:
        strength: share of the expected increment that it compensates; 0 is none.
        height_error_m: what its map adds to the true distance.
        late_s: how much later than the plate its map changes; negative is early.
    """

    strength: float = 0.0
    height_error_m: float = 0.0
    late_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PitchControl:
    """Hold one controller of the pitch bench.

    Attributes:
        gains: the cascade's gain set; None leaves the cascade out.
        rate_Hz: control rate; the gain set's own when None.
    """

    name: str
    gains: Gains | None
    observer: bool = False
    feedforward: Feedforward = Feedforward()
    pulses: PulseLaw = PulseLaw()
    rate_Hz: float | None = None
    law: ControlLaw = pitch_law.LAW

    @property
    def control_rate_Hz(self) -> float:
        """How often the controller runs."""
        if self.rate_Hz is not None:
            return self.rate_Hz
        if self.gains is None:
            raise InputError(f"controller {self.name!r} has no gains and no rate; give rate_Hz")
        return self.gains.control_rate_Hz
