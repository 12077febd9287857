"""Points of throttle tests: thrust and speed of one rotor, up and down separately."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

import numpy as np

from benchtool.core.channel import Channel, unit_from_name
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.data.columns import speed_columns


@dataclass(frozen=True, slots=True, eq=False)
class ThrottlePoints:
    """Points out of ground effect, each a mean over its samples; all arrays (n,).

    Attributes:
        way: 1 after a lower throttle, -1 after a higher one.
        thrust_N, thrust_se_N: of one rotor, mean over turning rotors.
        speed_rad_s, speed_se_rad_s: root mean square over turning rotors.
    """

    time_s: Array
    pulse_us: Array
    way: Array
    thrust_N: Array
    thrust_se_N: Array
    speed_rad_s: Array
    speed_se_rad_s: Array
    voltage_V: Array
    current_A: Array
    temperature_degC: Array
    run: Array

    @property
    def recording(self) -> Recording:
        """The points as a recording with one column per field."""
        names = type(self).__slots__
        channels = tuple(Channel(name, unit_from_name(name) or "1") for name in names)
        return Recording(channels, np.column_stack([getattr(self, name) for name in names]))

    @property
    def power_W(self) -> Array:
        """Electrical power of all turning rotors (n,): W."""
        return self.voltage_V * self.current_A


def throttle_points(points: Recording, rig: Rig, number: int) -> ThrottlePoints:
    """Return points of one rotor: the mean over turning rotors."""
    pulses = np.stack([points.column(name) for name in speed_columns(points.names, "pwm")])
    on = pulses > rig.propulsion.pwm_stop_us
    turning = np.maximum(on.sum(axis=0), 1)

    def per_rotor(ending: str) -> Array:
        return np.stack(
            [column_or_nan(points, f"rpm{rotor + 1}{ending}") for rotor in range(rig.n_rotors)]
        )

    rad_s = pi / 30.0
    speed = rad_s * np.sqrt(np.where(on, per_rotor("") ** 2, 0.0).sum(axis=0) / turning)
    errors = np.where(on, per_rotor("_se"), 0.0)
    level_us = pulses.max(axis=0)
    return ThrottlePoints(
        time_s=points.column("time_s"),
        pulse_us=level_us,
        way=_way(level_us),
        thrust_N=points.column("thrust_N") / turning,
        thrust_se_N=column_or_nan(points, "thrust_se_N") / turning,
        speed_rad_s=speed,
        speed_se_rad_s=rad_s * np.sqrt((errors**2).sum(axis=0)) / turning,
        voltage_V=column_or_nan(points, "voltage_V"),
        current_A=column_or_nan(points, "current_A"),
        temperature_degC=column_or_nan(points, "temperature_degC"),
        run=np.full(len(points), float(number)),
    )


def column_or_nan(recording: Recording, name: str) -> Array:
    """Return a column (n,); nan if the recording lacks it."""
    return recording.column(name) if name in recording else np.full(len(recording), np.nan)


def _way(level_us: Array) -> Array:
    """Return the sign of each throttle change; without a change, the opposite of the last sign."""
    change = np.sign(np.diff(level_us, prepend=0.0))
    for index in range(1, len(change)):
        if change[index] == 0.0:
            change[index] = -change[index - 1]
    return np.asarray(change, float)


def concatenate_points(parts: Sequence[ThrottlePoints]) -> ThrottlePoints:
    """Return the points of several recordings as one."""
    names = ThrottlePoints.__slots__
    return ThrottlePoints(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    )
