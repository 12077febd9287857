"""An address taken apart: its scheme, its place, its options as values within their ranges."""

from __future__ import annotations

import ipaddress
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.own_code import CodePermit, refuse_code

LOOPBACK = "127.0.0.1"


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Name one end of a link, for `benchtool doctor`.

    Attributes:
        kind: "serial" (`place` is its port), "listens" (a UDP port of ours), "sends" (a UDP port of
            theirs), "connects" (TCP).
    """

    kind: Literal["serial", "listens", "sends", "connects"]
    place: str
    port: int = 0


@dataclass(frozen=True, slots=True)
class Address:
    """Hold an address in its parts: `serial:COM12?baud=2000000` has place COM12, one option.

    Attributes:
        example: of an address of this scheme, for messages.
        permit: called with the file of a user's own code before it is run.
    """

    text: str
    scheme: str
    place: str
    options: Mapping[str, str] = field(default_factory=dict)
    example: str = ""
    permit: CodePermit = refuse_code

    def number(self, name: str, default: float, low: float, high: float) -> float:
        """Return an option as a number within its range, or its default."""
        if name not in self.options:
            return default
        given = self.options[name]
        try:
            value = float(given)
        except ValueError:
            raise InputError(
                f"option {name} of address {self.text!r} is {given!r}, not a number; "
                f"write {name}={default:g}"
            ) from None
        if not low <= value <= high:
            raise InputError(
                f"option {name} of address {self.text!r} is {given}, outside {low:g} to {high:g}; "
                f"write {name}={default:g}"
            )
        return value

    def whole(self, name: str, default: int, low: int, high: int) -> int:
        """Return an option as a whole number within its range, or its default."""
        value = self.number(name, default, low, high)
        if value != int(value):
            raise InputError(
                f"option {name} of address {self.text!r} is {value:g}, not a whole number; "
                f"write {name}={default}"
            )
        return int(value)

    def choice(self, name: str, default: str, known: tuple[str, ...]) -> str:
        """Return an option that is one of a few words, or its default."""
        given = self.options.get(name, default)
        if given not in known:
            raise UnknownChoice(f"{name} of address {self.text!r}", given, known)
        return given

    def host_and_port(
        self, place: str | None = None, default_host: str = "", of: str = ""
    ) -> tuple[str, int]:
        """Return host and port of a place `host:port`; the whole place of the address if None."""
        host, _, port = (self.place if place is None else place).rpartition(":")
        host = host.strip("[]") or default_host
        if not host or not port.isdecimal() or not 0 < int(port) < 65536:
            raise InputError(
                f"address {self.text!r} needs host and port{of}; write for example {self.example}"
            )
        return host, int(port)


def is_loopback(host: str) -> bool:
    """Return whether a host is this computer."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
