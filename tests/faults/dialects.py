"""What host and device say to each other, in three dialects: cut it into units, follow the phases
of a run in them, falsify them. Nothing of the program under test is imported.
"""

from __future__ import annotations

import binascii
import re
import struct
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Literal

TURNING_US = 1051.0  # a pulse from here on turns a rotor of the virtual bench (idle 1050 us)
STEADY_S = 0.30  # pulses that have not changed for so long are held: settling or sampling
Way = Literal["host", "device"]  # where a unit goes

Phase = Literal[
    "connect",  # the host opens the link
    "hello",  # it asks who is there
    "arming",  # latch cleared, stream started, stop pulse held
    "tare",
    "homing",  # a stage looks for its machine zero
    "moving",  # the plate is on its way
    "ramping",  # the first pulse above idle
    "sampling",  # pulses above idle, unchanged for STEADY_S
    "stopping",  # pulses on their way down
    "closing",  # a stop after rotors have turned
]


@dataclass(slots=True)
class Seen:
    """What host and device said, before any fault; times are those of the proxy's clock.

    Attributes:
        rows: values of each sample as text, by device time in us.
        commands: time and words of each command, its number left out.
        refused: time and reason of each refusal.
    """

    rows: dict[int, tuple[str, ...]] = field(default_factory=dict)
    channels: list[str] = field(default_factory=list)  # in the device's order
    phases: dict[str, float] = field(default_factory=dict)  # when each phase first began
    commands: list[tuple[float, str]] = field(default_factory=list)
    refused: list[tuple[float, str]] = field(default_factory=list)
    dropped_us: list[int] = field(default_factory=list)  # samples kept from the host


class Dialect(ABC):
    """Follow a conversation: the phase it is in, and what was said."""

    answers: tuple[bytes, ...] = ()  # how answers begin

    def __init__(self, seen: Seen | None = None) -> None:
        self.seen = seen or Seen()
        self.phase = ""
        self._pulse_us = 0.0
        self._changed_s = 0.0
        self._has_turned = False

    def split(self, way: Way, data: bytes) -> tuple[list[bytes], bytes]:
        """Return the whole units of a stream, and its rest."""
        *lines, rest = data.split(b"\n")
        return [line + b"\n" for line in lines], rest

    @abstractmethod
    def note(self, way: Way, unit: bytes, now_s: float) -> None:
        """Learn from a unit on its way."""

    @abstractmethod
    def is_sample(self, unit: bytes) -> bool:
        """Whether a unit brings measured values."""

    def is_answer(self, unit: bytes) -> bool:
        return unit.startswith(self.answers)

    def sample_us(self, unit: bytes) -> int:
        """Return the device's time of a sample; 0 where it is not said in each."""
        return 0

    def value(self, unit: bytes, channel: str) -> float | None:
        """Return a channel's value in a sample, None where it has none."""
        raise NotImplementedError

    def with_value(self, unit: bytes, channel: str, value: float) -> bytes:
        """Return a sample with another value of a channel."""
        raise NotImplementedError

    def acknowledged(self, unit: bytes) -> tuple[bytes, bytes] | None:
        """Return what answers a command that is swallowed, and what the device gets instead."""
        return None

    def begin(self, phase: Phase, now_s: float) -> None:
        self.phase = phase
        self.seen.phases.setdefault(phase, now_s)

    def let_pass(self, now_s: float) -> None:
        """Let time pass: pulses that stay are being held."""
        if self.phase == "ramping" and now_s - self._changed_s > STEADY_S:
            self.begin("sampling", now_s)

    def ordered(self, pulse_us: float, now_s: float) -> None:
        """Note the highest pulse that the host wants."""
        if pulse_us == self._pulse_us:
            return
        rises = pulse_us > self._pulse_us
        self._pulse_us, self._changed_s = pulse_us, now_s
        if rises and pulse_us >= TURNING_US:
            self._has_turned = True
            self.begin("ramping", now_s)
        elif not rises and self._has_turned:
            self.begin("stopping", now_s)

    def stopped(self, now_s: float) -> None:
        if self._has_turned:
            self._pulse_us = 0.0
            self.begin("closing", now_s)


class BenchLines(Dialect):
    """The bench protocol: framed lines of text."""

    answers = (b"$A,", b"$N,")

    def __init__(self, seen: Seen | None = None) -> None:
        super().__init__(seen)
        self._version = 2

    def note(self, way: Way, unit: bytes, now_s: float) -> None:
        fields = fields_in(unit)
        if way == "device" and fields[:1] == ["C"]:
            # In version 2 the time stands between name and values.
            aged = self._version == 2 and fields[2] != "hello"
            self._command(fields[2], fields[3 + aged :], now_s)
        elif way == "host" and fields[:1] == ["H"]:
            self._version = 2 if fields[1].isdecimal() else 1
            if "channel" in fields[1:3]:
                name = fields[fields.index("channel") + 1]
                if name not in self.seen.channels:
                    self.seen.channels.append(name)
        elif way == "host" and fields[:1] == ["N"]:
            self.seen.refused.append((now_s, ",".join(fields[3:])))
        elif way == "host" and fields[:1] == ["S"]:
            self.seen.rows[int(fields[2])] = tuple(fields[3:])

    def _command(self, name: str, values: list[str], now_s: float) -> None:
        self.seen.commands.append((now_s, ",".join([name, *values])))
        match name:
            case "hello":
                self.begin("hello", now_s)
            case "clear" | "rate" if self.phase == "hello":
                self.begin("arming", now_s)
            case "tare":
                self.begin("tare", now_s)
            case "plate":
                self.begin("moving", now_s)
            case "pwm":
                self.ordered(max(map(float, values)), now_s)
            case "stop":
                self.stopped(now_s)

    def is_sample(self, unit: bytes) -> bool:
        return unit.startswith(b"$S,")

    def sample_us(self, unit: bytes) -> int:
        return int(fields_in(unit)[2])

    def value(self, unit: bytes, channel: str) -> float | None:
        text = fields_in(unit)[3 + self.seen.channels.index(channel)]
        return float(text) if text else None

    def with_value(self, unit: bytes, channel: str, value: float) -> bytes:
        fields = fields_in(unit)
        fields[3 + self.seen.channels.index(channel)] = f"{value:.7g}"
        return framed(",".join(fields))

    def acknowledged(self, unit: bytes) -> tuple[bytes, bytes] | None:
        fields = fields_in(unit)
        # A rate of 0 is swallowed as well, so that the samples go on saying what the motors do.
        swallowed = fields[:1] == ["C"] and (
            fields[2] in ("pwm", "stop", "clear", "plate")
            or (fields[2] == "rate" and fields[-1] == "0")
        )
        # The device's watchdog is fed all the same, as by one that hears and does nothing.
        return (framed(f"A,{fields[1]},0"), framed("B")) if swallowed else None


def framed(payload: str) -> bytes:
    data = payload.encode()
    return b"$%b*%04X\n" % (data, binascii.crc_hqx(data, 0xFFFF))


def fields_in(line: bytes) -> list[str]:
    """Return the fields of a whole line, none of a damaged one."""
    payload, _, digits = line.strip().removeprefix(b"$").rpartition(b"*")
    whole = line.startswith(b"$") and digits == b"%04X" % binascii.crc_hqx(payload, 0xFFFF)
    return payload.decode("ascii", "replace").split(",") if whole else []


NAMES = {"plate_z_m": b"plate_z", "thrust_N": b"thrust"}  # named values that carry a channel

EXTRA = {77: 143, 251: 170}
"""What the checksum of a message ends with, by its number (MAVLink common.xml)."""


class MavlinkFrames(Dialect):
    """MAVLink 2, unsigned: what ArduPilot's motor test needs."""

    HEADER, CRC = 10, 2
    HEARTBEAT, PARAM_VALUE, COMMAND_LONG, COMMAND_ACK = 0, 22, 76, 77
    VERSION, NAMED_VALUE, TEXT = 148, 251, 253
    MOTOR_TEST, SET_INTERVAL = 209, 511

    def split(self, way: Way, data: bytes) -> tuple[list[bytes], bytes]:
        frames, at = [], 0
        while len(data) - at >= 2:
            size = self.HEADER + data[at + 1] + self.CRC
            if data[at] != 0xFD:  # a host that tries what else may be there
                size = len(data[at:].partition(b"\xfd")[0])
            if len(data) - at < size:
                break
            frames.append(data[at : at + size])
            at += size
        return frames, data[at:]

    def _message(self, unit: bytes) -> tuple[int, bytes]:
        """Return number and payload; MAVLink 2 cuts zeros off a payload's end."""
        number = int.from_bytes(unit[7:10], "little")
        return number, unit[self.HEADER : -self.CRC].ljust(60, b"\0")

    def note(self, way: Way, unit: bytes, now_s: float) -> None:
        if way == "host" or unit[0] != 0xFD:
            return
        number, payload = self._message(unit)
        self.seen.phases.setdefault("hello", now_s)
        if number == self.NAMED_VALUE and payload[8:].startswith(b"plate_z\0"):
            self.begin("moving", now_s)
        elif number == self.COMMAND_LONG:
            values = struct.unpack("<7fH", payload[:30])
            if values[7] == self.SET_INTERVAL:
                self.seen.phases.setdefault("arming", now_s)
            elif values[7] == self.MOTOR_TEST and values[3] > 0.0:
                self.ordered(values[2], now_s)
            elif values[7] == self.MOTOR_TEST:
                self.stopped(now_s)

    def is_sample(self, unit: bytes) -> bool:
        commands = (self.COMMAND_LONG, self.HEARTBEAT, self.VERSION, self.TEXT)
        return not self.is_answer(unit) and self._message(unit)[0] not in commands

    def is_answer(self, unit: bytes) -> bool:
        return self._message(unit)[0] in (self.COMMAND_ACK, self.PARAM_VALUE)

    def value(self, unit: bytes, channel: str) -> float | None:
        number, payload = self._message(unit)
        named = number == self.NAMED_VALUE and payload[8:18].rstrip(b"\0")
        return struct.unpack("<f", payload[4:8])[0] if named == NAMES[channel] else None

    def with_value(self, unit: bytes, channel: str, value: float) -> bytes:
        payload = self._message(unit)[1]
        return self._frame(
            unit[4:7], self.NAMED_VALUE, payload[:4] + struct.pack("<f", value) + payload[8:18]
        )

    def acknowledged(self, unit: bytes) -> tuple[bytes, bytes] | None:
        number, payload = self._message(unit)
        if number != self.COMMAND_LONG or payload[28:30] != struct.pack("<H", self.MOTOR_TEST):
            return None
        return self._frame(b"\0\x01\x01", self.COMMAND_ACK, payload[28:30]), b""

    def _frame(self, sender: bytes, number: int, payload: bytes) -> bytes:
        body = struct.pack("<BBB", len(payload), 0, 0) + sender + number.to_bytes(3, "little")
        crc = 0xFFFF
        for byte in body + payload + bytes([EXTRA[number]]):  # CRC-16/MCRF4XX
            byte ^= crc & 0xFF
            byte = (byte ^ byte << 4) & 0xFF
            crc = crc >> 8 ^ byte << 8 ^ byte << 3 ^ byte >> 4
        return b"\xfd" + body + payload + struct.pack("<H", crc)


class StageLines(Dialect):
    """A G-code stage: lines, and bytes that are words of their own. It knows its own phases only;
    those of the bench come from the conversation that it shares its `Seen` with.
    """

    answers = (b"ok", b"error")

    _UNITS = re.compile(rb"[?!~\x18\x85]|[^\n?!~\x18\x85]*\n")

    def split(self, way: Way, data: bytes) -> tuple[list[bytes], bytes]:
        if way == "host":
            return super().split(way, data)
        units = self._UNITS.findall(data)
        return units, data[sum(map(len, units)) :]

    def note(self, way: Way, unit: bytes, now_s: float) -> None:
        if way == "device" and unit.startswith(b"$H"):
            self.begin("homing", now_s)
        elif way == "device" and b"G1" in unit:
            self.begin("moving", now_s)

    def is_sample(self, unit: bytes) -> bool:
        return unit.startswith(b"<")

    def acknowledged(self, unit: bytes) -> tuple[bytes, bytes] | None:
        return (b"ok\r\n", b"") if b"G1" in unit else None
