"""The MAVLink messages that benchtool knows: pymavlink's own, and one that it lacks.

pymavlink is imported at the first call only, which takes a tenth of a second.
"""

from __future__ import annotations

import struct
from functools import cache
from typing import Any

Message = Any
"""One MAVLink message: pymavlink makes its classes without types."""


@cache
def dialect() -> Any:
    """Return pymavlink's module of the ardupilotmega dialect (which holds the common one)."""
    from pymavlink.dialects.v20 import ardupilotmega

    if ESC_STATUS not in ardupilotmega.mavlink_map:
        ardupilotmega.mavlink_map[ESC_STATUS] = _esc_status(ardupilotmega.MAVLink_message)
    return ardupilotmega


ESC_STATUS = 291
"""Number of the message in which PX4 reports the speeds of four ESCs; pymavlink 2.4.50 lacks it."""


def _esc_status(parent: Any) -> Any:
    """Return the class of ESC_STATUS, built as pymavlink builds its own (MAVLink common.xml)."""

    class EscStatus(parent):  # type: ignore[misc]
        id = ESC_STATUS
        msgname = name = "ESC_STATUS"
        fieldnames = ("index", "time_usec", "rpm", "voltage", "current")
        ordered_fieldnames = ("time_usec", "rpm", "voltage", "current", "index")
        fieldtypes = ("uint8_t", "uint64_t", "int32_t", "float", "float")
        orders = (4, 0, 1, 2, 3)
        lengths = (1, 4, 4, 4, 1)
        array_lengths = (0, 4, 4, 4, 0)
        crc_extra = 10
        unpacker = struct.Struct("<Q4i4f4fB")

        def __init__(
            self,
            index: int,
            time_usec: int,
            rpm: list[int],
            voltage: list[float],
            current: list[float],
        ) -> None:
            parent.__init__(self, self.id, self.msgname)
            self._fieldnames = list(self.fieldnames)
            self._instance_field, self._instance_offset = "index", -1
            self.index, self.time_usec = index, time_usec
            self.rpm, self.voltage, self.current = rpm, voltage, current

        def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
            payload = self.unpacker.pack(
                self.time_usec, *self.rpm, *self.voltage, *self.current, self.index
            )
            packed: bytes = self._pack(mav, self.crc_extra, payload, force_mavlink1=force_mavlink1)
            return packed

    return EscStatus
