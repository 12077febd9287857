"""Controller settings of the pitch bench."""

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
    pulses: PulseLaw = PulseLaw()
    rate_Hz: float | None = None
    law: ControlLaw = pitch_law.LAW

    @property
    def control_rate_Hz(self) -> float:
        """Control rate, of the gain set by default."""
        if self.rate_Hz is not None:
            return self.rate_Hz
        if self.gains is None:
            raise InputError(f"controller {self.name!r} has neither gains nor a rate; set rate_Hz")
        return self.gains.control_rate_Hz
