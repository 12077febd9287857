"""Every kind of address and the driver behind it.

A driver is named by a string, so that nothing here imports it before it is used, and so that the
simulator, which stands above this room, can be one of them. Nothing falls back to another scheme,
least of all to the simulator: a user who names a port that is not there gets that as an error.
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
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.user_code import CodePermit, check_code_allowed


@dataclass(frozen=True, slots=True, kw_only=True)
class Driver:
    """One kind of address.

    Attributes:
        opener: "module:function" that turns such an address into a bench, not opened yet.
    """

    address: type[Address]
    opener: str

    @property
    def example(self) -> str:
        return self.address.EXAMPLE


DRIVERS: dict[str, Driver] = {  # by the scheme of an address
    "sim": Driver(address=SimAddress, opener="benchtool.virtual.simulated_bench:open_simulated"),
    "serial": Driver(address=SerialAddress, opener="benchtool.bench.serial.bench:open_serial"),
    "tcp": Driver(address=TcpAddress, opener="benchtool.bench.serial.bench:open_tcp"),
    "mavlink": Driver(address=MavlinkAddress, opener="benchtool.bench.mavlink.bench:open_mavlink"),
    "replay": Driver(address=ReplayAddress, opener="benchtool.bench.replay:open_replay"),
}


def parse_address(text: str) -> Address:
    """Return the typed values of an address; nothing is opened and no file is read.

    Raises:
        InputError, UnknownChoice: it cannot be read.
    """
    scheme, colon, _ = text.strip().partition(":")
    if not colon:
        examples = ", ".join(driver.example for driver in DRIVERS.values())
        raise InputError(f"{text!r:.60} names no scheme; write it as one of: {examples}")
    if scheme not in DRIVERS:
        raise UnknownChoice("address scheme", scheme[:60], DRIVERS)
    return DRIVERS[scheme].address.parse(text)


def open_bench(address: str, permit: CodePermit = check_code_allowed) -> Bench:
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
    bench: Bench = load_object(DRIVERS[address.strip().partition(":")[0]].opener)(parsed)
    return bench


def load_object(name: str) -> Any:
    """Return what "module:function" names."""
    module, _, function = name.partition(":")
    return getattr(import_module(module), function)
