"""Injected faults of a virtual bench, given on the command line: `corrupt:p=0.001`.

Times of link faults are wall seconds since the host's hello, those of bench faults device seconds
since it. All default numbers are assumed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import inf

import numpy as np

from benchtool.core.channel import Channel
from benchtool.core.errors import InputError, StageError, UnknownChoice
from benchtool.core.units import Array
from benchtool.virtual.firmware import Plant


@dataclass(frozen=True, slots=True)
class Fault:
    """Fault by name, with the parameters that `FAULTS` lists for it."""

    name: str
    p: float = 0.0
    at_s: float = 0.0
    for_s: float = inf
    channel: str = ""
    thrust_N: float = 0.0

    def is_active(self, since_s: float) -> bool:
        """Return True while the fault is active."""
        return self.at_s <= since_s < self.at_s + self.for_s


FAULTS: dict[str, dict[str, float | str]] = {  # defaults of each fault
    # Link: drop each byte, or flip one bit of it, with probability p; delay all bytes and deliver
    # them together; send nothing; pull the cable.
    "drop": {"p": 0.001},
    "corrupt": {"p": 0.001},
    "delay": {"at_s": 5.0, "for_s": 0.3},
    "silence": {"at_s": 5.0, "for_s": 1.0},
    "unplug": {"at_s": 5.0, "for_s": inf},
    # Bench: repeat a channel's last value; add to the thrust; reject every move.
    "stuck": {"channel": "thrust_N", "at_s": 5.0, "for_s": inf},
    "over_thrust": {"at_s": 5.0, "for_s": 1.0, "thrust_N": 1000.0},
    "refuse_move": {"at_s": 0.0},
}


def parse_fault(text: str) -> Fault:
    """Parse a fault: `silence`, `silence:at_s=12,for_s=1`."""
    name, _, settings = text.partition(":")
    if name not in FAULTS:
        raise UnknownChoice("fault", name, FAULTS)
    parameters = dict(FAULTS[name])
    for part in filter(None, settings.split(",")):
        key, equals, value = part.partition("=")
        if key not in parameters:
            raise UnknownChoice(f"key of fault {name}", key, parameters)
        if not equals:
            raise InputError(f"fault {text!r}: {key!r} has no value; write {key}=NUMBER")
        parameters[key] = value if key == "channel" else _number(text, key, value)
    return Fault(name, **parameters)  # type: ignore[arg-type]


def _number(text: str, key: str, value: str) -> float:
    try:
        number = float(value)
    except ValueError:
        raise InputError(f"fault {text!r}: {key}={value!r} is not a number") from None
    if not number >= 0.0:
        raise InputError(f"fault {text!r}: {key}={number:g} is out of range; allowed: 0 or more")
    if key == "p" and number > 1.0:
        raise InputError(
            f"fault {text!r}: probability p={number:g} is out of range; allowed: 0 to 1"
        )
    return number


class LinkFaults:
    """Link faults, applied to the bytes of a device."""

    def __init__(
        self, faults: Iterable[Fault] = (), rng: np.random.Generator | None = None
    ) -> None:
        self._faults = tuple(faults)
        self._rng = rng if rng is not None else np.random.default_rng(0)
        self._delayed = bytearray()
        self._unplugged = False
        self._finished: set[Fault] = set()

    def carry(self, data: bytes, since_s: float) -> bytes:
        """Return the bytes to send, `since_s` seconds after the hello."""
        is_delayed = False
        for fault in self._faults:
            if fault.name == "drop" and data:
                passes = self._rng.random(len(data)) >= fault.p
                data = np.frombuffer(data, np.uint8)[passes].tobytes()
            elif fault.name == "corrupt" and data:
                hit = self._rng.random(len(data)) < fault.p
                bits = 1 << self._rng.integers(0, 8, len(data))
                data = (np.frombuffer(data, np.uint8) ^ (hit * bits).astype(np.uint8)).tobytes()
            elif fault.name == "silence" and fault.is_active(since_s):
                data = b""
            elif fault.name == "delay" and fault.is_active(since_s):
                is_delayed = True
        self._delayed += data
        if is_delayed:
            return b""
        data = bytes(self._delayed)
        self._delayed.clear()
        return data

    def plugged(self, since_s: float) -> bool | None:
        """Return False when the cable is pulled now, True when it is reconnected, else None."""
        for fault in self._faults:
            if fault.name != "unplug":
                continue
            if fault.is_active(since_s) and not self._unplugged and fault not in self._finished:
                self._unplugged = True
                return False
            if self._unplugged and since_s >= fault.at_s + fault.for_s:
                self._unplugged = False
                self._finished.add(fault)
                return True
        return None


class FaultyPlant:
    """Wrapper that adds bench faults to a plant, timed in device seconds since `begin`."""

    def __init__(self, plant: Plant, faults: Iterable[Fault]) -> None:
        self._plant = plant
        self._faults = tuple(faults)
        self.begin()
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
        """Restart the clock of the faults."""
        self._time_s = 0.0
        self._stuck: dict[str, float] = {}

    def command_plate(self, z_m: float, x_m: float, tilt_rad: float) -> None:
        if any(f.name == "refuse_move" and f.is_active(self._time_s) for f in self._faults):
            raise StageError("stage alarm; remove the obstruction, then home the stage")
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
