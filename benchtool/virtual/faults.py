"""Faults on demand for a virtual bench, each named on the command line: `corrupt:p=0.001`.

Faults of the link count wall seconds since the host's hello, faults of the bench count device
seconds since it. All default numbers are choices, not measurements.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import inf

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.channel import Channel
from benchtool.core.errors import InputError, StageError, UnknownChoice
from benchtool.virtual.firmware import Plant


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault by its name, with the numbers that `FAULTS` lists for it."""

    name: str
    p: float = 0.0
    at_s: float = 0.0
    for_s: float = inf
    channel: str = ""
    thrust_N: float = 0.0

    def acts(self, since_s: float) -> bool:
        """Whether it acts at a time."""
        return self.at_s <= since_s < self.at_s + self.for_s


FAULTS: dict[str, dict[str, float | str]] = {  # defaults of each fault
    # Of the link: lose every byte, or flip one bit of it, with probability p; hold all bytes back
    # and deliver them at once; send nothing; pull the cable.
    "drop": {"p": 0.001},
    "corrupt": {"p": 0.001},
    "delay": {"at_s": 5.0, "for_s": 0.3},
    "silence": {"at_s": 5.0, "for_s": 1.0},
    "unplug": {"at_s": 5.0, "for_s": inf},
    # Of the bench: repeat a channel's last value; add to the thrust; refuse every move.
    "stuck": {"channel": "thrust_N", "at_s": 5.0, "for_s": inf},
    "over_thrust": {"at_s": 5.0, "for_s": 1.0, "thrust_N": 1000.0},
    "refuse_move": {"at_s": 0.0},
}


def parse_fault(text: str) -> Fault:
    """Read a fault: `silence`, `silence:at_s=12,for_s=1`."""
    name, _, rest = text.partition(":")
    if name not in FAULTS:
        raise UnknownChoice("fault", name, FAULTS)
    given = dict(FAULTS[name])
    for part in filter(None, rest.split(",")):
        key, equals, value = part.partition("=")
        if key not in given:
            raise UnknownChoice(f"key of fault {name}", key, given)
        if not equals:
            raise InputError(f"fault key {key!r} in {text!r} has no value; write {key}=NUMBER")
        given[key] = value if key == "channel" else _number(text, key, value)
    return Fault(name, **given)  # type: ignore[arg-type]


def _number(text: str, key: str, value: str) -> float:
    try:
        number = float(value)
    except ValueError:
        raise InputError(f"{key}={value!r} in fault {text!r} is not a number; give one") from None
    if not number >= 0.0:
        raise InputError(f"{key}={number:g} in fault {text!r} is below 0; give 0 or more")
    if key == "p" and number > 1.0:
        raise InputError(f"p={number:g} in fault {text!r} is outside 0 to 1; give a probability")
    return number


class LinkFaults:
    """Apply the faults of the link among `faults` to a device's bytes."""

    def __init__(
        self, faults: Iterable[Fault] = (), rng: np.random.Generator | None = None
    ) -> None:
        self._faults = tuple(faults)
        self._rng = rng if rng is not None else np.random.default_rng(0)
        self._held = bytearray()
        self._unplugged = False
        self._spent: set[Fault] = set()

    def carry(self, data: bytes, since_s: float) -> bytes:
        """Return what of `data` goes out at so many seconds after the hello."""
        hold = False
        for fault in self._faults:
            if fault.name == "drop" and data:
                passes = self._rng.random(len(data)) >= fault.p
                data = np.frombuffer(data, np.uint8)[passes].tobytes()
            elif fault.name == "corrupt" and data:
                hit = self._rng.random(len(data)) < fault.p
                bits = 1 << self._rng.integers(0, 8, len(data))
                data = (np.frombuffer(data, np.uint8) ^ (hit * bits).astype(np.uint8)).tobytes()
            elif fault.name == "silence" and fault.acts(since_s):
                data = b""
            elif fault.name == "delay" and fault.acts(since_s):
                hold = True
        self._held += data
        if hold:
            return b""
        data = bytes(self._held)
        self._held.clear()
        return data

    def plugged(self, since_s: float) -> bool | None:
        """Return False when the cable is pulled now, True when it is put back, None otherwise."""
        for fault in self._faults:
            if fault.name != "unplug":
                continue
            if fault.acts(since_s) and not self._unplugged and fault not in self._spent:
                self._unplugged = True
                return False
            if self._unplugged and since_s >= fault.at_s + fault.for_s:
                self._unplugged = False
                self._spent.add(fault)
                return True
        return None


class FaultyPlant:
    """Plant with faults of the bench that begin so many device seconds after `begin`."""

    def __init__(self, plant: Plant, faults: Iterable[Fault]) -> None:
        self._plant = plant
        self._faults = tuple(faults)
        self._time_s = 0.0
        self._stuck: dict[str, float] = {}
        self.set_rate, self.command_pwm = plant.set_rate, plant.command_pwm
        self.halt_plate, self.tare = plant.halt_plate, plant.tare
        names = [channel.name for channel in plant.channels]
        for fault in self._faults:
            if fault.name == "stuck" and fault.channel not in names:
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

    def command_plate(self, z_m: float, x_m: float, tilt_rad: float) -> None:
        if any(one.name == "refuse_move" and one.acts(self._time_s) for one in self._faults):
            raise StageError("stage alarm; look for what blocks it, then home it")
        self._plant.command_plate(z_m, x_m, tilt_rad)

    def advance(self, n: int) -> Array:
        values = self._plant.advance(n)
        times_s = self._time_s + np.arange(1, n + 1) / self._plant.rate_Hz
        self._time_s += n / self._plant.rate_Hz
        names = [channel.name for channel in self._plant.channels]
        for fault in self._faults:
            rows = (times_s >= fault.at_s) & (times_s < fault.at_s + fault.for_s)
            if fault.name == "over_thrust" and "thrust_N" in names:
                values[rows, names.index("thrust_N")] += fault.thrust_N
            elif fault.name == "stuck":
                column = values[:, names.index(fault.channel)]
                fresh = np.flatnonzero(rows & np.isfinite(column))
                if len(fresh):
                    first = float(column[fresh[0]])
                    column[fresh] = self._stuck.setdefault(fault.channel, first)
        return values
