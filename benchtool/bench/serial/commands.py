"""What a host may ask of a bench device: each command a small value, with its text fields.

Pure: text fields in, values out. `docs/reference/bench-protocol.md` documents every field.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from math import isfinite
from typing import Any

from benchtool.core.errors import InputError, ProtocolError, UnknownChoice


@dataclass(frozen=True, slots=True)
class DeviceEvent:
    """Report something unasked: `watchdog`, `limit`, `arrived`, `stage`, `boot`, `dropped`."""

    kind: str
    text: str

    @property
    def stops_motors(self) -> bool:
        """Whether the device's motors stand still because of it."""
        return self.kind in ("watchdog", "limit", "boot")


MAX_COMMAND_AGE_S = 0.5
"""Orders are refused from this age on: a host waits 5 x 100 ms for an answer and then commands a
stop, so that an older order has been given up."""

LATE_REASON = "late: "  # How the reason of such a refusal begins


def is_too_old(reason: str) -> bool:
    """Return whether an order was refused for its age."""
    return reason.startswith(LATE_REASON) and " ms old" in reason


PROTOCOL_VERSION = 2  # Protocol version of host and device; another one is refused


@dataclass(frozen=True, slots=True)
class RequestHello:
    """Ask who is there; always executed, stops the stream and starts the numbering anew."""

    version: int = PROTOCOL_VERSION


@dataclass(frozen=True, slots=True)
class SetPwm:
    """Command every motor's pulse (n_rotors,): us."""

    pwm_us: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class SendPlate:
    """Send the plate somewhere; acknowledged when accepted, an `arrived` event says when there."""

    z_m: float
    x_m: float = 0.0
    tilt_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class RequestPlate:
    """Ask where the plate was last sent and whether it still moves."""


@dataclass(frozen=True, slots=True)
class TareDevice:
    """Take the present load-cell reading as zero thrust."""


@dataclass(frozen=True, slots=True)
class SetRate:
    """Stream so many samples per second; 0 stops the stream."""

    rate_Hz: float


@dataclass(frozen=True, slots=True)
class SetLimit:
    """Make one device-side limit narrower; the device never makes one wider."""

    name: str
    value: float


@dataclass(frozen=True, slots=True)
class StopDevice:
    """Command zero to every motor and halt the plate at once."""


@dataclass(frozen=True, slots=True)
class Clear:
    """Stop, and lift the latch that a watchdog or a limit has set."""


@dataclass(frozen=True, slots=True)
class ArmDevice:
    """Let the device obey pulses above stop and moves of the plate until the next stop.

    Acknowledged with the hash of the channel map.
    """


Command = (
    RequestHello
    | SetPwm
    | SendPlate
    | RequestPlate
    | TareDevice
    | SetRate
    | SetLimit
    | StopDevice
    | Clear
    | ArmDevice
)


@dataclass(frozen=True, slots=True)
class Reply:
    """Answer one command: accepted or refused, and why.

    Attributes:
        ok: whether the command was accepted.
        reason: the device's words when it was not.
        fields: what the acknowledgement carries beyond the device time, as text.
    """

    ok: bool
    reason: str = ""
    fields: tuple[str, ...] = ()


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ProtocolError(f"{text!r} is not a number; send digits, sign, point") from None
    if not isfinite(value):
        raise ProtocolError(f"{text!r} is not finite; send a finite number")
    return value


COMMANDS: dict[str, type[Command]] = {  # by name on the wire; fields in the order of the class
    "hello": RequestHello,
    "pwm": SetPwm,
    "plate": SendPlate,
    "where": RequestPlate,
    "tare": TareDevice,
    "rate": SetRate,
    "limit": SetLimit,
    "stop": StopDevice,
    "clear": Clear,
    "arm": ArmDevice,
}

_NAMES = {kind: name for name, kind in COMMANDS.items()}
_READERS: dict[str, Callable[[str], float | str]] = {
    "str": str,
    "int": lambda text: int(_number(text)),
    "float": _number,
}


def encode_command(value: float) -> str:
    """Return a number as it is sent: nine significant digits, no exponent padding."""
    if not isfinite(value):
        raise InputError(f"{value} cannot be sent to a device; give a finite number")
    return f"{value:.9g}"


def command_fields(command: Command) -> tuple[str, ...]:
    """Return the command's name on the wire followed by its fields."""
    values = [getattr(command, field.name) for field in fields(command)]
    if isinstance(command, SetPwm):
        values = list(command.pwm_us)
    texts = (value if isinstance(value, str) else encode_command(value) for value in values)
    return (_NAMES[type(command)], *texts)


def decode_command(words: Sequence[str]) -> Command:
    """Read a command from its name and fields; an unknown name lists the known ones."""
    name = words[0] if words else ""
    if name not in COMMANDS:
        raise UnknownChoice("command", name, COMMANDS)
    kind, given = COMMANDS[name], words[1:]
    if kind is SetPwm:
        return SetPwm(tuple(_number(text) for text in given))
    needed = fields(kind)
    if len(given) != len(needed):
        raise ProtocolError(f"command {name} takes {len(needed)} fields, got {len(given)}")
    read: list[Any] = [
        _READERS[str(field.type)](text) for field, text in zip(needed, given, strict=True)
    ]
    return kind(*read)
