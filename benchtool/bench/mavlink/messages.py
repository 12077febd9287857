"""MAVLink messages and commands: those of pymavlink, and one message that it lacks.

pymavlink is imported at the first call, because its import takes a tenth of a second.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cache
from typing import Any

from benchtool.core.errors import InputError

Message = Any  # one MAVLink message: pymavlink makes its classes without types


@cache
def dialect() -> Any:
    """Return pymavlink's module of the ardupilotmega dialect, which includes the common one."""
    from pymavlink.dialects.v20 import ardupilotmega

    if ESC_STATUS not in ardupilotmega.mavlink_map:
        ardupilotmega.mavlink_map[ESC_STATUS] = _build_esc_status(ardupilotmega.MAVLink_message)
    return ardupilotmega


ESC_STATUS = 291  # PX4's speeds of four ESCs; pymavlink 2.4.50 lacks it


def _build_esc_status(parent: Any) -> Any:
    """Return the class of ESC_STATUS, built as pymavlink's classes are (MAVLink common.xml)."""

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

        def __init__(self, *values: Any) -> None:
            parent.__init__(self, self.id, self.msgname)
            self._fieldnames = list(self.fieldnames)
            self._instance_field, self._instance_offset = "index", -1
            self.index, self.time_usec, self.rpm, self.voltage, self.current = values

        def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
            payload = self.unpacker.pack(
                self.time_usec, *self.rpm, *self.voltage, *self.current, self.index
            )
            packed: bytes = self._pack(mav, self.crc_extra, payload, force_mavlink1=force_mavlink1)
            return packed

    return EscStatus


AUTOPILOT_INVALID = 8  # MAV_AUTOPILOT of ground stations, gimbals and companion computers
ACCEPTED, IN_PROGRESS = 0, 5  # MAV_RESULT of an executed command

ARM_DISARM = 400
FORCE_DISARM = 21196.0  # second parameter of ARM_DISARM: in any state (MAVLink common.xml)
MOTOR_TEST = 209  # MAV_CMD_DO_MOTOR_TEST; 206 of some lists is a camera command

ACTUATOR_TEST = 310

SET_INTERVAL, REQUEST_MESSAGE = 511, 512

TIMEOUT_S = 0.25  # longest duration of a motor command: the watchdog of every bench
TIMEOUT_PARAMETERS = {MOTOR_TEST: 3, ACTUATOR_TEST: 1}  # index of the timeout parameter


@dataclass(frozen=True, slots=True)
class MavCommand:
    """One COMMAND_LONG: its number and seven parameters.

    A motor command lasts from 0 to `TIMEOUT_S`; no other can be built. ArduPilot treats a negative
    timeout as infinite, and nan crashes its program.

    Raises:
        InputError: timeout out of range.
    """

    command: int
    parameters: tuple[float, ...]

    def __post_init__(self) -> None:
        index = TIMEOUT_PARAMETERS.get(self.command)
        if index is not None and not 0.0 <= self.parameters[index] <= TIMEOUT_S:
            raise InputError(
                f"motor command timeout {self.parameters[index]:g} s is out of range; allowed: 0 "
                f"to {TIMEOUT_S:g} s"
            )

    def __str__(self) -> str:
        name = _enum_name("MAV_CMD", self.command)
        return f"{name} {','.join(f'{value:g}' for value in self.parameters)}"


def result_name(result: int) -> str:
    """Return the MAVLink name of a MAV_RESULT."""
    return _enum_name("MAV_RESULT", result)


def _enum_name(enum: str, value: int) -> str:
    entries = dialect().enums[enum]
    return str(entries[value].name).removeprefix(f"{enum}_") if value in entries else str(value)


def interval(name: str, rate_Hz: float) -> MavCommand:
    """Return the command that requests a message at a rate; 0 disables it."""
    interval_us = 1e6 / rate_Hz if rate_Hz > 0.0 else -1.0
    return MavCommand(SET_INTERVAL, (float(message_id(name)), interval_us, 0.0, 0.0, 0.0, 0.0, 0.0))


def message_id(name: str) -> int:
    """Return the number of a message."""
    return ESC_STATUS if name == "ESC_STATUS" else int(getattr(dialect(), f"MAVLINK_MSG_ID_{name}"))
