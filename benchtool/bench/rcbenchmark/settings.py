"""What an `rcbudp:` address says: where the GUI listens, and where its script sends to."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from benchtool.bench.rcbenchmark.bridge_file import GUI_PORT, HOST_PORT, LOOPBACK
from benchtool.core.errors import InputError

if TYPE_CHECKING:
    from benchtool.bench.transport.parsed_address import Address

EXAMPLE = f"rcbudp:{LOOPBACK}:{GUI_PORT}"


@dataclass(frozen=True, slots=True, kw_only=True)
class RcbSettings:
    """Say where the two ends of the bridge are.

    Attributes:
        host, port: where the script in the GUI listens.
        listen: port of this computer that the script sends to; 0 takes any, for a virtual stand.
        thrust_scale: factor on thrust, -1 for a stand that pushes where it should pull.
    """

    host: str = LOOPBACK
    port: int = GUI_PORT
    listen: int = HOST_PORT
    thrust_scale: float = 1.0

    @property
    def warning(self) -> str:
        """What must be said aloud of an end that listens beyond this computer, or nothing."""
        if is_loopback(self.host):
            return ""
        return (
            f"listening on UDP port {self.listen} of every network of this computer for "
            f"{self.host}: neither end can tell who sends, anybody there can turn the motor; use a "
            f"network of the two computers alone, or run benchtool beside the GUI"
        )


def rcb_settings_of(address: Address) -> RcbSettings:
    """Return what an address says.

    Raises:
        InputError: no host and port, or an option that makes no sense.
    """
    host, _, port = address.place.rpartition(":")
    if not port.isdecimal() or not 0 < int(port) < 65536:
        raise InputError(
            f"address {address.text!r} needs host and port of the GUI; write for example {EXAMPLE}"
        )
    return RcbSettings(
        host=host.strip("[]") or LOOPBACK,
        port=int(port),
        listen=address.whole("listen", HOST_PORT, 0, 65535),
        thrust_scale=address.number("thrust_scale", 1.0, -1e6, 1e6),
    )


def is_loopback(host: str) -> bool:
    """Tell whether a host is this computer."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
