"""Address schemes and their drivers.

Drivers are named by strings, so that none is imported before it is used and the simulator, in a
package above this one, can be listed. A missing port is an error: no scheme falls back to another.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any

from benchtool.bench.addresses import (
    Address,
    MavlinkAddress,
    ReplayAddress,
    SerialAddress,
    SimAddress,
    TcpAddress,
)
from benchtool.bench.bench import Bench
from benchtool.bench.transport.sockets import TcpSocket, UdpSocket
from benchtool.bench.transport.transport import Transport
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.user_code import CodePermit, check_code_allowed


@dataclass(frozen=True, slots=True, kw_only=True)
class Driver:
    """Driver of one address scheme."""

    address: type[Address]
    opener: str  # "module:function" that builds an unopened bench from an address

    @property
    def example(self) -> str:
        return self.address.EXAMPLE


DRIVERS: dict[str, Driver] = {  # by address scheme
    "sim": Driver(address=SimAddress, opener="benchtool.virtual.simulated_bench:open_simulated"),
    "serial": Driver(address=SerialAddress, opener="benchtool.bench.serial.bench:open_serial"),
    "tcp": Driver(address=TcpAddress, opener="benchtool.bench.serial.bench:open_serial"),
    "mavlink": Driver(address=MavlinkAddress, opener="benchtool.bench.mavlink.bench:open_mavlink"),
    "replay": Driver(address=ReplayAddress, opener="benchtool.bench.replay:open_replay"),
}


def parse_address(text: str) -> Address:
    """Return the parsed address; no link is opened and no file is read."""
    scheme, colon, _ = text.strip().partition(":")
    if not colon:
        examples = ", ".join(driver.example for driver in DRIVERS.values())
        raise InputError(f"{text!r:.60} has no address scheme; use one of: {examples}")
    if scheme not in DRIVERS:
        raise UnknownChoice("address scheme", scheme[:60], DRIVERS)
    return DRIVERS[scheme].address.parse(text)


def open_bench(address: str, permit: CodePermit = check_code_allowed) -> Bench:
    """Return the bench of an address, not opened; enter it with `with`, or call `open()`.

    Args:
        address: as typed by a user or stored in data.
        permit: called with the file of user-defined effects in the address before the file is run;
            it must raise unless a user typed the address.
    """
    parsed_address = replace(parse_address(address), permit=permit)
    bench: Bench = load_object(DRIVERS[address.strip().partition(":")[0]].opener)(parsed_address)
    return bench


def build_transport(address: Address) -> Transport:
    """Return the link of an address, not opened yet."""
    if isinstance(address, SerialAddress):
        return _build_port(address.port, address.baud)
    if isinstance(address, TcpAddress):
        return TcpSocket(address.host, address.port)
    if not isinstance(address, MavlinkAddress):
        raise InputError(
            f"{address.text!r} has no port to check; give a serial port or a network address"
        )
    if address.link == "serial":
        return _build_port(address.serial_port, address.baud)
    if address.link == "tcp":
        return TcpSocket(address.host, address.port)
    return UdpSocket(address.host, address.port, listen=address.link == "udpin")


def _build_port(port: str, baud: int) -> Transport:
    from benchtool.bench.transport.serial_port import SerialPort

    return SerialPort(port, baud)


def load_object(name: str) -> Any:
    """Return the object of "module:function"."""
    module, _, function = name.partition(":")
    return getattr(import_module(module), function)
