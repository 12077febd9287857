"""Serial ports: which there are, and what answers on them when asked."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from benchtool.bench.serial.conversation import Conversation
from benchtool.bench.transport.transport import Transport
from benchtool.core.counted import counted
from benchtool.core.errors import NoDevice, PortBusy, PortDenied, ProtocolError

BY_ID = Path("/dev/serial/by-id")


@dataclass(frozen=True, slots=True, kw_only=True)
class Port:
    """Describe one serial port.

    Attributes:
        name: as it is opened (`/dev/ttyUSB0`, `COM12`).
        description: the system's words.
        serial_number: of the USB device, empty where it has none.
        vendor, product: USB numbers, None for a port that is not on USB.
        by_id: a name that stays the same after a replug, empty where there is none (Linux only).
    """

    name: str
    description: str = ""
    serial_number: str = ""
    vendor: int | None = None
    product: int | None = None
    by_id: str = ""

    @property
    def usb(self) -> str:
        """Vendor and product as `0403:6001`, empty when the port is not on USB."""
        if self.vendor is None or self.product is None:
            return ""
        return f"{self.vendor:04x}:{self.product:04x}"


@dataclass(frozen=True, slots=True)
class PortAnswer:
    """Say what answered on a port when it was asked for a hello."""

    kind: Literal["bench", "other", "silent", "busy", "denied"]
    text: str


def serial_ports() -> tuple[Port, ...]:
    """Return the serial ports behind which there is hardware, in natural order."""
    from serial.tools import list_ports

    names = by_id_names()
    found = [
        Port(
            name=item.device,
            description=item.description if item.description != "n/a" else "",
            serial_number=item.serial_number or "",
            vendor=item.vid,
            product=item.pid,
            by_id=names.get(os.path.realpath(item.device), ""),
        )
        for item in list_ports.comports()
        if item.hwid != "n/a" or item.vid is not None
    ]
    return tuple(sorted(found, key=lambda port: _natural(port.name)))


def by_id_names(folder: Path = BY_ID) -> dict[str, str]:
    """Return the lasting name of each port by the port it leads to now."""
    if not folder.is_dir():
        return {}
    return {os.path.realpath(link): str(link) for link in sorted(folder.iterdir())}


def ask_port(
    transport: Transport, name: str, clock: Callable[[], float] = time.monotonic
) -> PortAnswer:
    """Open a port and ask who is there; opening resets many boards, and motors stay untouched."""
    talk = Conversation(transport, f"serial:{name}", clock)
    try:
        hello = talk.open()
    except PortBusy as error:
        return PortAnswer("busy", str(error))
    except PortDenied as error:
        return PortAnswer("denied", str(error))
    except NoDevice as error:
        return PortAnswer("silent", str(error))
    except ProtocolError as error:
        return PortAnswer("other", str(error))
    finally:
        talk.close()
    rotors = counted(hello.n_rotors, "rotor")
    virtual = ", virtual" if hello.simulated else ""
    return PortAnswer("bench", f"{hello.device_id}, {hello.firmware}, {rotors}{virtual}")


def _natural(name: str) -> list[str | int]:
    """Sort COM9 before COM10."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)]
