"""Commands of the bench protocol as values, encoded to and decoded from text fields.

Pure functions. `docs/reference/bench-protocol.md` documents every field.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from math import isfinite
from typing import Any

from benchtool.core.errors import InputError, ProtocolError, UnknownChoice


@dataclass(frozen=True, slots=True)
class DeviceEvent:
    """Unsolicited event: `watchdog`, `limit`, `arrived`, `stage`, `boot`, `dropped`."""

    kind: str
    text: str

    @property
    def stops_motors(self) -> bool:
        """Return whether the device stopped its motors because of it."""
        return self.kind in ("watchdog", "limit", "boot")


# Older commands are rejected: a host waits 5 x 100 ms for an acknowledgement and then commands a
# stop, so an older command was given up.
MAX_COMMAND_AGE_S = 0.5

LATE_REASON = "late: "  # start of the reason of such a rejection


def is_too_old(reason: str) -> bool:
    """Return whether a command was rejected for its age."""
    return reason.startswith(LATE_REASON) and " ms old" in reason


PROTOCOL_VERSION = 2  # of host and device; any other version is rejected


@dataclass(frozen=True, slots=True)
class RequestHello:
    """Request the device information; always executed, stops the stream, restarts numbering."""

    version: int = PROTOCOL_VERSION


@dataclass(frozen=True, slots=True)
class SetPwm:
    """Command the pulse width of every motor (n_rotors,): us."""

    pwm_us: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class SendPlate:
    """Move the plate; acknowledged on acceptance, an `arrived` event reports the arrival."""

    z_m: float
    x_m: float = 0.0
    tilt_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class RequestPlate:
    """Request the last target of the plate and whether it still moves."""


@dataclass(frozen=True, slots=True)
class TareDevice:
    """Tare the load cell: the present reading becomes zero thrust."""


@dataclass(frozen=True, slots=True)
class SetRate:
    """Set the stream rate in samples per second; 0 stops the stream."""

    rate_Hz: float


@dataclass(frozen=True, slots=True)
class SetLimit:
    """Narrow one limit on the device, which never widens one."""

    name: str
    value: float


@dataclass(frozen=True, slots=True)
class StopDevice:
    """Command zero to every motor and stop the plate immediately."""


@dataclass(frozen=True, slots=True)
class Clear:
    """Stop, and clear the latch that a watchdog or a limit has set."""


@dataclass(frozen=True, slots=True)
class ArmDevice:
    """Allow pulse widths above stop and moves of the plate until the next stop.

    The acknowledgement contains the hash of the channel map.
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
    """Reply to one command."""

    ok: bool  # the command was accepted
    reason: str = ""  # reason of a rejection, as the device reports it
    fields: tuple[str, ...] = ()  # fields of the acknowledgement after the device time, as text


def _parse_number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ProtocolError(f"{text!r} is not a number; send digits, sign, point") from None
    if not isfinite(value):
        raise ProtocolError(f"{text!r} is not finite; send a finite number")
    return value


COMMANDS: dict[str, type[Command]] = {  # by name in the protocol; fields in the order of the class
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

_COMMAND_NAMES = {kind: name for name, kind in COMMANDS.items()}
_PARSERS: dict[str, Callable[[str], float | str]] = {
    "str": str,
    "int": lambda text: int(_parse_number(text)),
    "float": _parse_number,
}


def format_number(value: float) -> str:
    """Return a number in protocol format: nine significant digits, no exponent padding."""
    if not isfinite(value):
        raise InputError(f"{value} cannot be sent to a device; give a finite number")
    return f"{value:.9g}"


def command_fields(command: Command) -> tuple[str, ...]:
    """Return the command's protocol name followed by its fields."""
    values = [getattr(command, field.name) for field in fields(command)]
    if isinstance(command, SetPwm):
        values = list(command.pwm_us)
    texts = (value if isinstance(value, str) else format_number(value) for value in values)
    return (_COMMAND_NAMES[type(command)], *texts)


def decode_command(words: Sequence[str]) -> Command:
    """Parse a command from its name and fields; the error for an unknown name lists all names."""
    name = words[0] if words else ""
    if name not in COMMANDS:
        raise UnknownChoice("command", name, COMMANDS)
    kind, texts = COMMANDS[name], words[1:]
    if kind is SetPwm:
        return SetPwm(tuple(_parse_number(text) for text in texts))
    kind_fields = fields(kind)
    if len(texts) != len(kind_fields):
        raise ProtocolError(f"command {name} takes {len(kind_fields)} fields, got {len(texts)}")
    values: list[Any] = [
        _PARSERS[str(field.type)](text) for field, text in zip(kind_fields, texts, strict=True)
    ]
    return kind(*values)
