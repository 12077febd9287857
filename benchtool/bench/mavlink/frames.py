"""MAVLink messages, commands and frames: encoding, decoding, loss counts. Pure functions.

pymavlink is imported at the first call, because its import takes a tenth of a second.
"""

from __future__ import annotations

import struct
from collections import OrderedDict
from dataclasses import dataclass, field, fields
from functools import cache
from math import sqrt
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


GROUND_SYSTEM, GROUND_COMPONENT = 255, 190  # ids of a ground station (MAVLink convention)

AUTOPILOT_COMPONENT = 1
SEQUENCE_MODULUS = 256
# Largest delay of a frame in frames, a quarter of the modulus; a link that reorders is off by a
# few, a restarted autopilot by any number; assumed.
REORDER_WINDOW = 64

MAVLINK_2, SIGNED = 0xFD, 1  # first byte of a frame of MAVLink 2; bit of a signed frame
SIGNING_EPOCH_S = 1_420_070_400.0  # 2015-01-01 UTC (MAVLink 2 message signing)


@dataclass(slots=True)
class LinkCounts:
    """Counts of frames."""

    messages: int = 0
    lost: int = 0  # missing sequence numbers, over all components of a system
    corrupt: int = 0  # discarded for checksum or signature
    duplicates: int = 0
    reordered: int = 0  # received after a later one

    def add(self, other: LinkCounts) -> None:
        for count in fields(self):
            setattr(self, count.name, getattr(self, count.name) + getattr(other, count.name))


@dataclass(slots=True)
class _Source:
    """Sequence numbers of one component; each has its own."""

    last: int | None = None
    recent: OrderedDict[int, bytes] = field(default_factory=OrderedDict)
    missing: set[int] = field(default_factory=set)
    counts: LinkCounts = field(default_factory=LinkCounts)
    unnumbered: bool = False

    def take(self, number: int, frame: bytes) -> bool:
        """Count a frame; return whether it is new.

        A component with the same number in all frames, as some scripts send, can have neither
        lost nor duplicate frames.
        """
        previous = self.recent.get(number, frame)
        if number == self.last and frame != previous:
            self.unnumbered = True
        if self.unnumbered:
            self.counts.messages += 1
            return True
        if number in self.recent and frame == previous:
            self.counts.duplicates += 1
            return False
        step = 0 if self.last is None else (number - self.last) % SEQUENCE_MODULUS
        if step >= SEQUENCE_MODULUS - REORDER_WINDOW and number in self.missing:
            self.missing.discard(number)
            self.counts.lost -= 1
            self.counts.reordered += 1
        else:
            if 1 < step < SEQUENCE_MODULUS - REORDER_WINDOW:
                # A restarted count also loses the numbers in between.
                self.counts.lost += step - 1
                self.missing |= {
                    (number - seq) % SEQUENCE_MODULUS for seq in range(1, min(step, REORDER_WINDOW))
                }
            self.last = number
            if self.missing:
                ages = {seq: (number - seq) % SEQUENCE_MODULUS for seq in self.missing}
                self.missing = {seq for seq, age in ages.items() if 0 < age < REORDER_WINDOW}
        self.counts.messages += 1
        self.recent[number] = frame
        self.recent.move_to_end(number)
        if len(self.recent) > REORDER_WINDOW:
            self.recent.popitem(last=False)
        return True


class MavlinkFrames:
    """Packer and parser of messages for one system.

    Attributes:
        corrupt: frames discarded since the last `take_counts`, for checksum or signature.
        unsigned: number of all frames so far that were rejected for their signature.
        received: at least one valid frame was received.
        signs: sent frames are signed, and received frames must be.
    """

    def __init__(
        self,
        system: int = GROUND_SYSTEM,
        component: int = GROUND_COMPONENT,
        key: bytes | None = None,  # 32 bytes to sign and to check frames; None disables signing
        now_s: float = 0.0,  # since 1970, for the signatures
        # False accepts every frame, as an autopilot does: the next host restarts its numbers, and
        # its first frames may equal those of the previous host
        counts: bool = True,
    ) -> None:
        module = dialect()
        self._counts = counts
        self.corrupt = self.unsigned = 0
        self.received = False
        self._sources: dict[tuple[int, int], _Source] = {}
        self._lost_carry: dict[int, int] = {}
        self._bad = module.MAVLink_bad_data
        self._mav = module.MAVLink(None, system, component)
        self._mav.robust_parsing = True
        self.signs = key is not None
        if key is not None:
            signing = self._mav.signing
            signing.secret_key, signing.sign_outgoing = key, True
            signing.link_id = 0
            signing.timestamp = max(0, round((now_s - SIGNING_EPOCH_S) * 1e5))

    def pack(self, message: Message) -> bytes:
        frame: bytes = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % SEQUENCE_MODULUS
        return frame

    def parse(self, data: bytes) -> list[Message]:
        """Return the messages that `data` completes; invalid bytes never raise."""
        good = []
        for message in (self._mav.parse_buffer(data) if data else None) or ():
            if type(message) is self._bad:
                # Text and boot messages before the first frame do not count as corrupt.
                unsigned = "signature" in str(message.reason)
                self.unsigned += unsigned
                self.corrupt += self.received or unsigned
                continue
            if not self._counts:
                good.append(message)
                continue
            source = (message.get_srcSystem(), message.get_srcComponent())
            state = self._sources.setdefault(source, _Source())
            if state.take(message.get_seq(), bytes(message.get_msgbuf())):
                good.append(message)
        self.received = self.received or bool(good)
        return good

    def take_counts(self, system: int) -> LinkCounts:
        """Return the counts of all components of a system since the last call.

        Sequence numbers wrap at 256, so a gap of 256 or more is underestimated.
        """
        counts = LinkCounts(corrupt=self.corrupt)
        for (owner, _), state in self._sources.items():
            if owner == system:
                counts.add(state.counts)
                state.counts = LinkCounts()
        # A late frame is subtracted in the call in which it arrives, or in later ones.
        counts.lost += self._lost_carry.get(system, 0)
        self._lost_carry[system] = min(counts.lost, 0)
        counts.lost = max(counts.lost, 0)
        self.corrupt = 0
        return counts


def is_signed(message: Message) -> bool:
    """Return whether a message has a signature, checked or not."""
    frame = bytes(message.get_msgbuf())
    return frame[0] == MAVLINK_2 and bool(frame[2] & SIGNED)


class MavlinkQuality:
    """Message counts and the jitter of their arrival.

    Jitter is the standard deviation of arrival time minus the autopilot's time, over steps between
    consecutive messages (RFC 3550 smooths the same quantity).
    """

    def __init__(self) -> None:
        self.counts = LinkCounts()
        self._steps = 0
        self._squares_s2 = 0.0
        self._previous: tuple[float, float] | None = None

    def arrived(self, arrived_s: float, device_s: float) -> None:
        """Record the arrival and creation time of a message, each on its own clock."""
        if self._previous is not None and device_s > self._previous[1]:
            step_s = (arrived_s - self._previous[0]) - (device_s - self._previous[1])
            self._steps += 1
            self._squares_s2 += step_s**2
        self._previous = (arrived_s, device_s)

    def facts(self) -> dict[str, str]:
        counts, jitter_s = self.counts, sqrt(self._squares_s2 / max(self._steps, 1))
        return {
            "link_lost": f"{counts.lost} of {counts.messages + counts.lost} messages",
            "link_duplicates": str(counts.duplicates),
            "link_reordered": str(counts.reordered),
            "link_jitter_ms": f"{1e3 * jitter_s:.2f}",
        }
