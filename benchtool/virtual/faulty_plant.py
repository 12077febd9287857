"""A plant with faults in it: a stuck channel, too much thrust, a stage that refuses."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from benchtool.core.channel import Channel
from benchtool.core.errors import StageError, UnknownChoice
from benchtool.virtual.faults import Fault, OverThrust, RefuseMove, Stuck
from benchtool.virtual.firmware import Plant

Array = NDArray[np.float64]


class FaultyPlant:
    """Be another plant, with faults that begin so many device seconds after `begin`.

    Args:
        plant: the healthy one.
        faults: those of the link among them are left to `LinkFaults`.
    """

    def __init__(self, plant: Plant, faults: Iterable[Fault]) -> None:
        self._plant = plant
        self._faults = tuple(faults)
        self._time_s = 0.0
        self._stuck: dict[str, float] = {}
        names = [channel.name for channel in plant.channels]
        for fault in self._faults:
            if isinstance(fault, Stuck) and fault.channel not in names:
                raise UnknownChoice("channel of fault stuck", fault.channel, names)

    @property
    def channels(self) -> tuple[Channel, ...]:
        return self._plant.channels

    @property
    def rate_Hz(self) -> float:
        return self._plant.rate_Hz

    @property
    def plate_moving(self) -> bool:
        return self._plant.plate_moving

    def begin(self) -> None:
        """Start the faults' time anew."""
        self._time_s = 0.0
        self._stuck = {}

    def set_rate(self, rate_Hz: float) -> None:
        self._plant.set_rate(rate_Hz)

    def command_pwm(self, pwm_us: Array) -> None:
        self._plant.command_pwm(pwm_us)

    def command_plate(self, z_m: float, x_m: float, tilt_rad: float) -> None:
        for fault in self._faults:
            if isinstance(fault, RefuseMove) and self._time_s >= fault.at_s:
                raise StageError("stage alarm; look for what blocks it, then home it")
        self._plant.command_plate(z_m, x_m, tilt_rad)

    def halt_plate(self) -> None:
        self._plant.halt_plate()

    def tare(self) -> None:
        self._plant.tare()

    def advance(self, n: int) -> Array:
        values = self._plant.advance(n)
        times_s = self._time_s + np.arange(1, n + 1) / self._plant.rate_Hz
        self._time_s += n / self._plant.rate_Hz
        names = [channel.name for channel in self._plant.channels]
        for fault in self._faults:
            if isinstance(fault, Stuck | OverThrust):
                rows = (times_s >= fault.at_s) & (times_s < fault.at_s + fault.for_s)
                if isinstance(fault, Stuck):
                    self._stick(fault, values[:, names.index(fault.channel)], rows)
                elif "thrust_N" in names:
                    values[rows, names.index("thrust_N")] += fault.thrust_N
        return values

    def _stick(self, fault: Stuck, column: Array, rows: NDArray[np.bool_]) -> None:
        """Repeat in `column`, where it has values in `rows`, the value of the first of them."""
        fresh = np.flatnonzero(rows & np.isfinite(column))
        if len(fresh):
            column[fresh] = self._stuck.setdefault(fault.channel, float(column[fresh[0]]))
