"""Every kind of address, its parts and options, and the driver behind it.

A driver is named by a string, so that nothing here imports it before it is used, and so that the
simulator, which stands above this room, can be one of them. Nothing falls back to another scheme,
least of all to the simulator: a user who names a port that is not there gets that as an error.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import Any, Literal
from urllib.parse import parse_qsl

from benchtool.bench.bench import Bench
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
        value = self.number(name, default, low, high)
        if value != int(value):
            raise InputError(
                f"option {name} of address {self.text!r} is {value:g}, not a whole number; "
                f"write {name}={default}"
            )
        return int(value)

    def choice(self, name: str, default: str, known: tuple[str, ...]) -> str:
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


LONGEST_ADDRESS = 1024
"""Longest address, in characters; a choice: a path and some options."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Driver:
    """Describe one kind of address.

    Attributes:
        opener: "module:function" that turns an `Address` into a bench, not opened yet.
        ends: "module:function" that turns an `Address` into the ends of its link, which
            `benchtool doctor` looks at; empty where there is none.
    """

    opener: str
    example: str
    options: tuple[str, ...] = ()
    ends: str = ""


DRIVERS: dict[str, Driver] = {
    "sim": Driver(
        opener="benchtool.virtual.simulated:open_simulated",
        example="sim:pquad?seed=3",
        options=("truth", "seed", "rate", "mode", "schedule", "controller", "gains", "hidden"),
    ),
    "serial": Driver(
        opener="benchtool.bench.serial.bench:open_serial",
        example="serial:/dev/ttyUSB0?baud=2000000",
        options=("baud",),
        ends="benchtool.bench.transport.serial_port:serial_ends",
    ),
    "tcp": Driver(
        opener="benchtool.bench.serial.bench:open_tcp",
        example="tcp:127.0.0.1:5555",
        ends="benchtool.bench.transport.sockets:tcp_ends",
    ),
    "mavlink": Driver(
        opener="benchtool.bench.mavlink.bench:open_mavlink",
        example="mavlink:udpin:127.0.0.1:14550",
        options=(
            *("system", "rotors", "map", "mode", "arm", "rate", "key"),
            *("thrust", "thrust_scale", "rpm", "distance", "orientation", "cell"),
        ),
        ends="benchtool.bench.mavlink.settings:mavlink_ends",
    ),
    "rcbudp": Driver(
        opener="benchtool.bench.rcbenchmark.bench:open_rcbudp",
        example="rcbudp:127.0.0.1:55047",
        options=("listen", "thrust_scale"),
        ends="benchtool.bench.rcbenchmark.link:rcbudp_ends",
    ),
    "replay": Driver(
        opener="benchtool.bench.replay:open_replay", example="replay:runs/2026-01-31-first"
    ),
}
"""Every driver by the scheme of its addresses."""


def parse_address(text: str) -> Address:
    """Split an address and check its scheme and the names of its options."""
    if len(text) > LONGEST_ADDRESS:
        raise InputError(
            f"the address {text[:40]!r}... has {len(text):,} characters, limit "
            f"{LONGEST_ADDRESS:,}; write for example {DRIVERS['sim'].example}"
        )
    scheme, colon, rest = text.strip().partition(":")
    if not colon:
        examples = ", ".join(driver.example for driver in DRIVERS.values())
        raise InputError(f"{text!r} names no scheme; write it as one of: {examples}")
    if scheme not in DRIVERS:
        raise UnknownChoice("address scheme", scheme, DRIVERS)
    known = DRIVERS[scheme]
    # Windows device paths (\\?\...) hold a question mark of their own, before any option.
    head = rest[:4] if rest.startswith("\\\\?\\") else ""
    place, _, query = rest[len(head) :].partition("?")
    if not head + place:
        raise InputError(f"address {text!r} names no place; write for example {known.example}")
    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=True) if query else []
    except ValueError:
        raise InputError(
            f"the options of address {text!r} cannot be read; write them as name=value joined by &"
        ) from None
    if not all(map(str.isprintable, (place, *(value for _, value in pairs)))):
        raise InputError(f"address {text!r} holds characters that no name has; type it anew")
    for name, _ in pairs:
        if name not in known.options:
            raise UnknownChoice(f"option of {scheme}: addresses", name, known.options)
    return Address(text, scheme, head + place, dict(pairs), known.example)


def open_bench(address: str, permit: CodePermit = refuse_code) -> Bench:
    """Return the bench of an address, not opened yet: enter it with `with`, or call `open()`.

    Args:
        address: as a person wrote it, or as data hold it.
        permit: called with the file of a truth's own effects before it is run; only an address
            that a person wrote may have one that does not refuse.

    Raises:
        InputError, UnknownChoice: the address cannot be read.
        FileFormatError: a file that it names cannot be read.
    """
    parsed = replace(parse_address(address), permit=permit)
    bench: Bench = load(DRIVERS[parsed.scheme].opener)(parsed)
    return bench


def ends_of(address: Address) -> tuple[Endpoint, ...]:
    """Return the ends of an address's link, none for one that has no link."""
    ends = DRIVERS[address.scheme].ends
    found: tuple[Endpoint, ...] = load(ends)(address) if ends else ()
    return found


def load(name: str) -> Any:
    """Return what "module:function" names."""
    module, _, function = name.partition(":")
    return getattr(import_module(module), function)
