"""Faults on demand for a virtual bench, each a small value named on the command line.

`corrupt:p=0.001` names one. Faults of the link count wall seconds since the host's hello, faults of
the bench count device seconds since it. All default numbers are choices, not measurements.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from math import inf

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array import Array
from benchtool.core.channel import Channel
from benchtool.core.errors import InputError, StageError, UnknownChoice
from benchtool.virtual.firmware import Plant


@dataclass(frozen=True, slots=True)
class Drop:
    """Lose every byte with probability p."""

    p: float = 0.001


@dataclass(frozen=True, slots=True)
class Corrupt:
    """Turn one bit of every byte with probability p."""

    p: float = 0.001


@dataclass(frozen=True, slots=True)
class Delay:
    """Hold all bytes back for a while, then deliver them at once."""

    at_s: float = 5.0
    for_s: float = 0.3


@dataclass(frozen=True, slots=True)
class Silence:
    """Send nothing for a while."""

    at_s: float = 5.0
    for_s: float = 1.0


@dataclass(frozen=True, slots=True)
class Unplug:
    """Pull the cable, for good or for a while."""

    at_s: float = 5.0
    for_s: float = inf


@dataclass(frozen=True, slots=True)
class Stuck:
    """Repeat one channel's last value."""

    channel: str = "thrust_N"
    at_s: float = 5.0
    for_s: float = inf


@dataclass(frozen=True, slots=True)
class OverThrust:
    """Add to the thrust reading."""

    at_s: float = 5.0
    for_s: float = 1.0
    thrust_N: float = 1000.0


@dataclass(frozen=True, slots=True)
class RefuseMove:
    """Let the stage refuse every move from some time on."""

    at_s: float = 0.0


LinkFault = Drop | Corrupt | Delay | Silence | Unplug

BenchFault = Stuck | OverThrust | RefuseMove

Fault = LinkFault | BenchFault

FAULTS: dict[str, type[Fault]] = {
    "drop": Drop,
    "corrupt": Corrupt,
    "delay": Delay,
    "silence": Silence,
    "unplug": Unplug,
    "stuck": Stuck,
    "over_thrust": OverThrust,
    "refuse_move": RefuseMove,
}
"""Every fault by its name."""


def fault_from(text: str) -> Fault:
    """Read a fault: `silence`, `silence:at_s=12,for_s=1`.

    Raises:
        UnknownChoice: no fault or key of that name; the message lists the known ones.
        InputError: a value that is no number, or a probability outside 0 to 1.
    """
    name, _, rest = text.partition(":")
    if name not in FAULTS:
        raise UnknownChoice("fault", name, FAULTS)
    kind = FAULTS[name]
    known = {item.name: item.type for item in fields(kind)}
    given: dict[str, float | str] = {}
    for part in filter(None, rest.split(",")):
        key, equals, value = part.partition("=")
        if key not in known:
            raise UnknownChoice(f"key of fault {name}", key, known)
        if not equals:
            raise InputError(f"fault key {key!r} in {text!r} has no value; write {key}=NUMBER")
        given[key] = value if known[key] == "str" else _number(text, key, value)
    return kind(**given)  # type: ignore[arg-type]


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
    """Do to a device's bytes what the faults say.

    Args:
        faults: those of the bench among them are left to `FaultyPlant`.
        rng: decides which bytes are hit.
    """

    def __init__(
        self, faults: Iterable[Fault] = (), rng: np.random.Generator | None = None
    ) -> None:
        self._faults = [fault for fault in faults if isinstance(fault, LinkFault)]
        self._rng = rng if rng is not None else np.random.default_rng(0)
        self._held = bytearray()
        self._unplugged = False
        self._spent: set[Unplug] = set()

    def carry(self, data: bytes, since_s: float) -> bytes:
        """Return what of `data` goes out at so many seconds after the hello."""
        if not self._faults:
            return data
        hold = False
        for fault in self._faults:
            match fault:
                case Drop(p) if data:
                    passes = self._rng.random(len(data)) >= p
                    data = np.frombuffer(data, np.uint8)[passes].tobytes()
                case Corrupt(p) if data:
                    hit = self._rng.random(len(data)) < p
                    bits = 1 << self._rng.integers(0, 8, len(data))
                    data = (np.frombuffer(data, np.uint8) ^ (hit * bits).astype(np.uint8)).tobytes()
                case Silence() if _now(fault, since_s):
                    data = b""
                case Delay() if _now(fault, since_s):
                    hold = True
        if hold:
            self._held += data
            return b""
        data = bytes(self._held) + data
        self._held.clear()
        return data

    def plugged(self, since_s: float) -> bool | None:
        """Return False when the cable is pulled now, True when it is put back, None otherwise."""
        for fault in self._faults:
            if not isinstance(fault, Unplug):
                continue
            out = _now(fault, since_s)
            if out and not self._unplugged and fault not in self._spent:
                self._unplugged = True
                return False
            if self._unplugged and since_s >= fault.at_s + fault.for_s:
                self._unplugged = False
                self._spent.add(fault)
                return True
        return None


def _now(fault: Delay | Silence | Unplug | Stuck | OverThrust, since_s: float) -> bool:
    return fault.at_s <= since_s < fault.at_s + fault.for_s


class FaultyPlant:
    """Be another plant, with faults that begin so many device seconds after `begin`.

    Args:
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
