"""A fault proxy between a host and a device of the bench protocol, in memory and on a clock of the
test's own; it imports nothing of the program under test.

It cuts the traffic into lines, follows from them the phase that the run is in, records what the
device says before any fault touches it, and does faults to the lines of one direction.

    host  <-- near end --  Proxy  -- far end -->  device
"""

from __future__ import annotations

import binascii
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf
from typing import Literal

TURNING_US = 1051.0
"""A pulse from here on turns a rotor of the virtual bench (idle 1050 us)."""

STEADY_S = 0.30
"""Pulses that have not changed for so long are held: settling or sampling."""

Way = Literal["host", "device"]
"""Where a line goes."""

Phase = Literal[
    "connect",  # the host opens the link
    "hello",  # it asks who is there
    "arming",  # latch cleared, stream started, stop pulse held
    "tare",
    "moving",  # the plate is on its way
    "ramping",  # the first pulse above idle
    "sampling",  # pulses above idle, unchanged for STEADY_S
    "stopping",  # pulses on their way down
    "closing",  # a stop after rotors have turned
]

Kind = Literal[
    "drop",
    "delay",  # by delay_s
    "duplicate",
    "reorder",  # pairs change places
    "corrupt",  # one bit turned
    "truncate",  # the first half of the line, without its end
    "stall",  # lines wait until the fault is over, then come at once
    "cut",  # the cable is pulled
    "freeze",  # a channel of the samples repeats its value
    "lie",  # `value` is added to a channel of the samples
    "ignore",  # the proxy acknowledges a command that the device never gets
]


@dataclass(slots=True)
class Wire:
    """One direction's bytes that nobody has taken yet."""

    waiting: bytearray = field(default_factory=bytearray)

    def take(self) -> bytes:
        data = bytes(self.waiting)
        self.waiting.clear()
        return data


@dataclass(slots=True)
class End:
    """One end of the proxy: what came from this side and what goes to it."""

    incoming: Wire = field(default_factory=Wire)
    outgoing: Wire = field(default_factory=Wire)
    is_cut: bool = False

    def write(self, data: bytes) -> None:
        if not self.is_cut:
            self.outgoing.waiting += data


@dataclass(slots=True)
class Seen:
    """What host and device said, before any fault; times are those of the proxy's clock.

    Attributes:
        pulses: time and highest pulse of any motor in each sample.
        plate_m: time and plate distance in each sample.
        rows: values of each sample as text, by device time in us.
        commands: time and words of each command, its number left out.
        refused: time and reason of each refusal.
    """

    pulses: list[tuple[float, float]] = field(default_factory=list)
    plate_m: list[tuple[float, float]] = field(default_factory=list)
    rows: dict[int, tuple[str, ...]] = field(default_factory=dict)
    channels: list[str] = field(default_factory=list)  # in the device's order
    phases: dict[str, float] = field(default_factory=dict)  # when each phase first began
    commands: list[tuple[float, str]] = field(default_factory=list)
    refused: list[tuple[float, str]] = field(default_factory=list)
    dropped: int = 0  # samples that a fault kept from the host


@dataclass
class Fault:
    """One fault: what, to which lines, when, for how long.

    Attributes:
        channel, value: for freeze and lie.
        begun_s, hit: when it began and how many lines it hit; a test asserts that it did.
    """

    kind: Kind
    phase: Phase = "sampling"  # it begins `after_s` after this phase first began
    after_s: float = 0.0
    for_s: float = inf  # it lasts so long
    way: Way | Literal["both"] = "both"  # lines on their way to the host, to the device, or both
    only: str = "all"  # "all" lines, "samples", "answers", or a text that a line must contain
    times: int = 1 << 30  # at most so many lines are hit, after the first `skip` that it would take
    skip: int = 0
    p: float = 1.0  # share of lines hit, drawn with `seed`
    delay_s: float = 0.3
    channel: str = "plate_z_m"
    value: float = 0.0
    seed: int = 0

    begun_s: float | None = None
    hit: int = 0

    def __post_init__(self) -> None:
        self.random = random.Random(self.seed)
        self.held: float | None = None
        self.back: bytes | None = None

    def is_on(self, seen: Seen, now_s: float) -> bool:
        started_s = seen.phases.get(self.phase)
        if started_s is None or now_s < started_s + self.after_s:
            return False
        if self.begun_s is None:
            self.begun_s = now_s
        return now_s < self.begun_s + self.for_s and self.hit < self.times

    def takes(self, way: Way, line: bytes) -> bool:
        if self.way not in (way, "both") or not self._fits(line):
            return False
        if self.p < 1.0 and self.random.random() >= self.p:
            return False
        self.skip -= 1
        return self.skip < 0

    def _fits(self, line: bytes) -> bool:
        if self.only == "all":
            return True
        if self.only == "samples":
            return is_sample(line)
        if self.only == "answers":
            return line.startswith((b"$A,", b"$N,"))
        return self.only.encode() in line


class Follower:
    """Follow a conversation: the phase it is in, and what was said."""

    def __init__(self) -> None:
        self.seen = Seen()
        self.phase = ""
        self._version = 2
        self._pulse_us = 0.0
        self._changed_s = 0.0
        self._has_turned = False

    def begin(self, phase: Phase, now_s: float) -> None:
        self.phase = phase
        self.seen.phases.setdefault(phase, now_s)

    def let_pass(self, now_s: float) -> None:
        """Let time pass: pulses that stay are being held."""
        if self.phase == "ramping" and now_s - self._changed_s > STEADY_S:
            self.begin("sampling", now_s)

    def note(self, way: Way, line: bytes, now_s: float) -> None:
        """Learn from a line on its way."""
        fields = fields_in(line)
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
            self._sample(int(fields[2]), fields[3:], now_s)

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
                self._commanded(max(map(float, values)), now_s)
            case "stop" if self._has_turned:
                self._pulse_us = 0.0
                self.begin("closing", now_s)

    def _commanded(self, pulse_us: float, now_s: float) -> None:
        if pulse_us == self._pulse_us:
            return
        rises = pulse_us > self._pulse_us
        self._pulse_us, self._changed_s = pulse_us, now_s
        if rises and pulse_us >= TURNING_US:
            self._has_turned = True
            self.begin("ramping", now_s)
        elif not rises and self._has_turned:
            self.begin("stopping", now_s)

    def _sample(self, time_us: int, values: list[str], now_s: float) -> None:
        named = dict(zip(self.seen.channels, values, strict=False))
        pulses = [float(text) for name, text in named.items() if name.startswith("pwm") and text]
        if pulses:
            self.seen.pulses.append((now_s, max(pulses)))
        if z_m := named.get("plate_z_m"):
            self.seen.plate_m.append((now_s, float(z_m)))
        self.seen.rows[time_us] = tuple(values)


class Proxy:
    """Carry lines between two ends and do faults to them.

    Args:
        clock: seconds; time passes with `step` only.
    """

    def __init__(self, faults: list[Fault], clock: Callable[[], float]) -> None:
        self.near, self.far = End(), End()
        self.faults = faults
        self.follower = Follower()
        self._clock = clock
        self._rest: dict[Way, bytes] = {"host": b"", "device": b""}
        self._late: list[tuple[float, Way, bytes]] = []
        self._stalled: list[tuple[Way, bytes]] = []

    @property
    def seen(self) -> Seen:
        return self.follower.seen

    def connect(self) -> None:
        """Note that the host opens the link."""
        self.follower.begin("connect", self._clock())

    def step(self) -> None:
        """Carry what has come on both sides."""
        now_s = self._clock()
        self.follower.let_pass(now_s)
        for fault in self.faults:  # a cable is pulled although nothing is said
            if fault.kind == "cut" and fault.is_on(self.seen, now_s) and not fault.hit:
                fault.hit = 1
                self.near.is_cut = True
        self._carry("device", self.near.incoming.take(), now_s)
        self._carry("host", self.far.incoming.take(), now_s)
        self._release(now_s)

    def _carry(self, way: Way, data: bytes, now_s: float) -> None:
        *lines, self._rest[way] = (self._rest[way] + data).split(b"\n")
        for whole in lines:
            line = whole + b"\n"
            # First noted: a fault of a phase may hit the very line that begins it.
            self.follower.note(way, line, now_s)
            pieces = [line]
            for fault in self.faults:
                if fault.is_on(self.seen, now_s):
                    pieces = [out for one in pieces for out in self._through(fault, way, one)]
            for piece in pieces:
                self._send(way, piece)

    def _through(self, fault: Fault, way: Way, line: bytes) -> list[bytes]:
        """Return what a fault leaves of a line."""
        if not fault.takes(way, line):
            return [line]
        fault.hit += 1
        if fault.kind in ("drop", "corrupt", "truncate"):
            self.seen.dropped += way == "host" and is_sample(line)
        match fault.kind:
            case "drop" | "cut":
                return []
            case "delay":
                self._late.append((self._clock() + fault.delay_s, way, line))
                return []
            case "duplicate":
                return [line, line]
            case "reorder":
                back, fault.back = fault.back, None if fault.back else line
                return [line, back] if back else []
            case "corrupt":
                bad = bytearray(line)
                bad[fault.random.randrange(len(line) - 1)] ^= 1 << fault.random.randrange(7)
                return [bytes(bad)]
            case "truncate":
                return [line[: len(line) // 2]]
            case "stall":
                self._stalled.append((way, line))
                return []
            case "freeze" | "lie":
                return [self._falsified(fault, line)]
            case "ignore":
                return self._ignored(fault, line)

    def _falsified(self, fault: Fault, line: bytes) -> bytes:
        fields = fields_in(line)
        if fields[:1] != ["S"]:
            fault.hit -= 1
            return line
        place = 3 + self.seen.channels.index(fault.channel)
        if not fields[place]:
            return line
        present = float(fields[place])
        if fault.held is None:
            fault.held = present
        new = fault.held if fault.kind == "freeze" else present + fault.value
        fields[place] = f"{new:.7g}"
        return framed(",".join(fields))

    def _ignored(self, fault: Fault, line: bytes) -> list[bytes]:
        fields = fields_in(line)
        # A rate of 0 is swallowed as well, so that the samples go on saying what the motors do.
        swallowed = fields[:1] == ["C"] and (
            fields[2] in ("pwm", "stop", "clear", "plate")
            or (fields[2] == "rate" and fields[-1] == "0")
        )
        if not swallowed:
            fault.hit -= 1
            return [line]
        self._send("host", framed(f"A,{fields[1]},0"))
        # The device's watchdog is fed all the same, as by one that hears and does nothing.
        return [framed("B")]

    def _release(self, now_s: float) -> None:
        for item in [item for item in self._late if item[0] <= now_s]:
            self._late.remove(item)
            self._send(*item[1:])
        stalls = [fault for fault in self.faults if fault.kind == "stall"]
        if self._stalled and not any(fault.is_on(self.seen, now_s) for fault in stalls):
            waiting, self._stalled = self._stalled, []
            for way, line in waiting:
                self._send(way, line)

    def _send(self, way: Way, data: bytes) -> None:
        (self.near if way == "host" else self.far).write(data)


def is_sample(line: bytes) -> bool:
    return line.startswith(b"$S,")


def framed(payload: str) -> bytes:
    data = payload.encode()
    return b"$%b*%04X\n" % (data, binascii.crc_hqx(data, 0xFFFF))


def fields_in(line: bytes) -> list[str]:
    """Return the fields of a whole line, none of a damaged one."""
    payload, _, digits = line.strip().removeprefix(b"$").rpartition(b"*")
    whole = line.startswith(b"$") and digits == b"%04X" % binascii.crc_hqx(payload, 0xFFFF)
    return payload.decode("ascii", "replace").split(",") if whole else []
