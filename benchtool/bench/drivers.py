"""Addresses: `scheme:where?option=value` to a bench, not opened yet.

Nothing falls back to another scheme, least of all to the simulator: a user who names a port that
is not there is told so.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

from benchtool.bench.address import Address
from benchtool.bench.bench import Bench
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.own_code import CodePermit, refuse_code

LONGEST_ADDRESS = 1024
"""Longest address, in characters; a choice: a path and some options."""

DEFAULT_BAUD = 2_000_000
"""Rate of a serial address that names none: what the protocol's description recommends."""


@dataclass(frozen=True, slots=True)
class Scheme:
    """Describe one kind of address: how to open it, its options, an example for people."""

    opener: Callable[[Address, CodePermit], Bench]
    options: tuple[str, ...]
    example: str


def parse_address(text: str) -> Address:
    """Split an address and check its scheme and the names of its options.

    Raises:
        InputError: no scheme, nothing after it, or an option without a value.
        UnknownChoice: a scheme or an option that does not exist, with the known ones.
    """
    if len(text) > LONGEST_ADDRESS:
        raise InputError(
            f"the address {text[:40]!r}... has {len(text):,} characters, limit "
            f"{LONGEST_ADDRESS:,}; write for example {SCHEMES['sim'].example}"
        )
    scheme, colon, rest = text.strip().partition(":")
    if not colon:
        raise InputError(f"{text!r} names no scheme; write it as one of: {', '.join(_examples())}")
    if scheme not in SCHEMES:
        raise UnknownChoice("address scheme", scheme, SCHEMES)
    known = SCHEMES[scheme]
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
    return Address(text, scheme, head + place, dict(pairs))


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
    parsed = parse_address(address)
    return SCHEMES[parsed.scheme].opener(parsed, permit)


def _examples() -> list[str]:
    return [scheme.example for scheme in SCHEMES.values()]


MODES = ("plate", "pitch")
"""What a virtual bench is: a load cell over a plate, or a pitch hinge with a controller."""

MAVLINK_OPTIONS = (
    *("system", "rotors", "map", "mode", "arm", "rate", "key"),
    *("thrust", "thrust_scale", "rpm", "distance", "orientation", "cell"),
)
"""What may follow the place of a `mavlink:` address; mavlink_settings.py says what each means."""

_PITCH_OPTIONS = ("schedule", "controller", "gains", "hidden")


def _simulated(address: Address, permit: CodePermit) -> Bench:
    mode = address.options.get("mode", "plate")
    if mode not in MODES:
        raise UnknownChoice(f"mode of address {address.text!r}", mode, MODES)
    if mode == "pitch":
        return _simulated_pitch(address, permit)
    for name in _PITCH_OPTIONS:
        if name in address.options:
            raise InputError(
                f"option {name} of address {address.text!r} is for mode=pitch; add &mode=pitch"
            )
    from benchtool.core.rig_file import rig_named
    from benchtool.core.toml_text import build
    from benchtool.physics.model_file import load_model
    from benchtool.simulate.imperfections import Imperfections
    from benchtool.virtual.devices import standard_truth
    from benchtool.virtual.simulated import SimulatedBench

    rig = rig_named(address.place)
    truth = address.options.get("truth", standard_truth(rig))
    loaded = load_model(truth, rig, permit)
    return SimulatedBench(
        address.text,
        rig,
        loaded.model,
        seed=address.whole("seed", 0, 0, 2**32 - 1),
        rate_Hz=address.number("rate", 200.0, 1.0, 5000.0),
        imperfections=build(Imperfections, dict(loaded.imperfections), f"{truth}: [imperfections]"),
    )


def _simulated_pitch(address: Address, permit: CodePermit) -> Bench:
    from benchtool.core.rig_file import rig_named
    from benchtool.virtual.devices import pitch_plant
    from benchtool.virtual.simulated import SimulatedPitch

    seed = address.whole("seed", 0, 0, 2**32 - 1)
    rate_Hz = address.number("rate", 0.0, 1.0, 5000.0)
    # A plus sign in an address reads as a space.
    named: dict[str, Any] = {
        name: address.options[name].replace(" ", "+")
        for name in ("truth", *_PITCH_OPTIONS)
        if name in address.options
    }
    plant = pitch_plant(
        rig_named(address.place), seed=seed, rate_Hz=rate_Hz or None, permit=permit, **named
    )
    return SimulatedPitch(address.text, plant, seed)


def _serial(address: Address, permit: CodePermit) -> Bench:
    from benchtool.bench.serial.bench import SerialBench
    from benchtool.bench.transport.serial_port import SerialPort

    baud = address.whole("baud", DEFAULT_BAUD, 1200, 12_000_000)
    return SerialBench(SerialPort(address.place, baud), address.text)


def _tcp(address: Address, permit: CodePermit) -> Bench:
    from benchtool.bench.serial.bench import SerialBench
    from benchtool.bench.transport.sockets import TcpSocket

    host, _, port = address.place.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise InputError(
            f"address {address.text!r} needs host and port; write for example tcp:127.0.0.1:5555"
        )
    return SerialBench(TcpSocket(host.strip("[]"), int(port)), address.text)


def _replay(address: Address, permit: CodePermit) -> Bench:
    from benchtool.bench.replay import ReplayBench

    return ReplayBench.of_run(address.text, Path(address.place))


def _mavlink(address: Address, permit: CodePermit) -> Bench:
    from benchtool.bench.mavlink.bench import MavlinkBench
    from benchtool.bench.mavlink.settings import settings_of, transport_of
    from benchtool.bench.transport.serial_port import SerialPort

    settings = settings_of(address)
    cell = SerialPort(*settings.cell) if settings.cell else None
    return MavlinkBench(transport_of(address), address.text, settings, cell=cell)


def _rcbudp(address: Address, permit: CodePermit) -> Bench:
    from benchtool.bench.rcbenchmark.bench import RcbBench
    from benchtool.bench.rcbenchmark.link import rcb_settings_of
    from benchtool.bench.transport.sockets import UdpSocket

    settings = rcb_settings_of(address)
    port = UdpSocket(settings.host, settings.port, listen=False, own_port=settings.listen)
    return RcbBench(port, address.text, settings)


SCHEMES: dict[str, Scheme] = {
    "sim": Scheme(
        _simulated, ("truth", "seed", "rate", "mode", *_PITCH_OPTIONS), "sim:pquad?seed=3"
    ),
    "serial": Scheme(_serial, ("baud",), "serial:/dev/ttyUSB0?baud=2000000"),
    "tcp": Scheme(_tcp, (), "tcp:127.0.0.1:5555"),
    "mavlink": Scheme(_mavlink, MAVLINK_OPTIONS, "mavlink:udpin:127.0.0.1:14550"),
    "rcbudp": Scheme(_rcbudp, ("listen", "thrust_scale"), "rcbudp:127.0.0.1:55047"),
    "replay": Scheme(_replay, (), "replay:runs/2026-01-31-first"),
}
"""Every kind of address; another driver costs one line here."""
