"""The seam for controllers: one method, called once per control period.

A user's controller is any class with `step`; it may keep state, and a simulation makes a new one
for every run. The built-in laws are expressions over numbers (`pid`, `observer`, `cascade`), run
inside the compiled loop; `pitch_law` wraps them in this seam.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol, TypeVar

MeasurementT = TypeVar("MeasurementT", contravariant=True)
ReferenceT = TypeVar("ReferenceT", contravariant=True)
CommandT = TypeVar("CommandT", covariant=True)


class Controller(Protocol[MeasurementT, ReferenceT, CommandT]):
    """Turn what was measured into what is commanded."""

    def step(self, measurement: MeasurementT, reference: ReferenceT, dt_s: float) -> CommandT:
        """Return the command for the control period that begins now.

        Args:
            measurement: the sensors' latest readings.
            reference: what is wanted now.
            dt_s: length of the control period: s.
        """
        ...


class PitchMeasurement(NamedTuple):
    """What a pitch bench's controller sees.

    Attributes:
        time_s: since the run began.
        theta_rad: encoder, positive nose down.
        rate_rad_s: gyro.
        plate_z_m: reading of the plate's distance with the beam level: m.
        speed_rad_s: rotor speeds (n,).
    """

    time_s: float
    theta_rad: float
    rate_rad_s: float
    plate_z_m: float
    speed_rad_s: tuple[float, ...]


class PitchReference(NamedTuple):
    """What is wanted of a pitch bench: attitude (rad) and collective thrust per rotor (N)."""

    theta_rad: float
    collective_N: float


class PitchCommand(NamedTuple):
    """What a pitch bench is told.

    Attributes:
        torque_Nm: wanted torque about the pitch axis, positive nose down; the mixer shares it out.
        difference_us: added to the pulse of the rotors that push nose down, subtracted from the
            opposite ones; for laws that are written in pulse widths.
    """

    torque_Nm: float
    difference_us: float = 0.0
