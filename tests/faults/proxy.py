"""A fault proxy between a host and a device, in memory and on a clock that is handed in; it imports
nothing of the program under test.

It cuts the traffic into units (lines, frames, words), follows from them the phase that the run is
in, records what the device says before any fault touches it, and does faults to the units of one
direction.

    host  <-- near end --  Proxy  -- far end -->  device
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf
from typing import Literal

from tests.faults.dialects import BenchLines, Dialect, Phase, Seen, Way

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
    "replace",  # `only` becomes `text`
    "happen",  # to the device itself: `text` says what
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


class Unit(bytes):
    """A unit as its sender wrote it, and when; what a fault has changed is bytes."""

    written_s: float


@dataclass
class Fault:
    """One fault: what, to which lines, when, for how long.

    Attributes:
        channel, value: for freeze and lie.
        text: for replace and happen.
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
    text: str = ""
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

    def takes(self, way: Way, line: bytes, dialect: Dialect) -> bool:
        if self.kind == "happen" or self.way not in (way, "both") or not self._fits(line, dialect):
            return False
        if self.p < 1.0 and self.random.random() >= self.p:
            return False
        self.skip -= 1
        return self.skip < 0

    def _fits(self, line: bytes, dialect: Dialect) -> bool:
        if self.only == "all":
            return True
        if self.only == "samples":
            return dialect.is_sample(line)
        if self.only == "answers":
            return dialect.is_answer(line)
        return self.only.encode() in line


class Proxy:
    """Carry lines between two ends and do faults to them.

    Args:
        clock: seconds; time passes with `step` only.

    Attributes:
        happen: lets something happen to the device.
        heard_s, written_s: when a whole unit of the host last reached the device, and when the
            host had written it.
        delivered: all that reached the host.
    """

    happen: Callable[[str], None]

    def __init__(
        self, faults: list[Fault], clock: Callable[[], float], dialect: Dialect | None = None
    ) -> None:
        self.near, self.far = End(), End()
        self.faults = faults
        self.dialect = dialect or BenchLines()
        self.heard_s = self.written_s = -inf
        self.delivered = bytearray()
        self._clock = clock
        self._rest: dict[Way, bytes] = {"host": b"", "device": b""}
        self._late: list[tuple[float, Way, bytes]] = []
        self._stalled: list[tuple[Way, bytes]] = []

    @property
    def seen(self) -> Seen:
        return self.dialect.seen

    def connect(self) -> None:
        """Note that the host opens the link."""
        self.dialect.begin("connect", self._clock())

    def step(self) -> None:
        """Carry what has come on both sides."""
        now_s = self._clock()
        self.dialect.let_pass(now_s)
        for fault in self.faults:  # a cable is pulled although nothing is said
            if fault.kind == "cut" and fault.is_on(self.seen, now_s) and not self.near.is_cut:
                fault.hit += 1
                self.near.is_cut = True
            elif fault.kind == "happen" and fault.is_on(self.seen, now_s) and not fault.hit:
                fault.hit = 1
                self.happen(fault.text)
        self._release(now_s)  # what was held back comes before what comes now: no link reorders
        self._carry("device", self.near.incoming.take(), now_s)
        self._carry("host", self.far.incoming.take(), now_s)
        self._release(now_s)

    def _carry(self, way: Way, data: bytes, now_s: float) -> None:
        lines, self._rest[way] = self.dialect.split(way, self._rest[way] + data)
        for line in map(Unit, lines):
            line.written_s = now_s
            # First noted: a fault of a phase may hit the very line that begins it.
            self.dialect.note(way, line, now_s)
            pieces: list[bytes] = [line]
            for fault in self.faults:
                if fault.is_on(self.seen, now_s):
                    pieces = [out for one in pieces for out in self._through(fault, way, one)]
            for piece in pieces:
                self._send(way, piece)

    def _through(self, fault: Fault, way: Way, line: bytes) -> list[bytes]:
        """Return what a fault leaves of a line."""
        if not fault.takes(way, line, self.dialect):
            return [line]
        fault.hit += 1
        lost = way == "host" and fault.kind in ("drop", "corrupt", "truncate")
        if lost and self.dialect.is_sample(line):
            self.seen.dropped_us.append(self.dialect.sample_us(line))
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
                bad[fault.random.randrange(max(len(line) - 1, 1))] ^= 1 << fault.random.randrange(7)
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
            case "replace":
                return [line.replace(fault.only.encode(), fault.text.encode())]

    def _falsified(self, fault: Fault, line: bytes) -> bytes:
        present = None
        if self.dialect.is_sample(line):
            present = self.dialect.value(line, fault.channel)
        if present is None:
            fault.hit -= 1
            return line
        if fault.held is None:
            fault.held = present
        new = fault.held if fault.kind == "freeze" else present + fault.value
        return self.dialect.with_value(line, fault.channel, new)

    def _ignored(self, fault: Fault, line: bytes) -> list[bytes]:
        swallowed = self.dialect.acknowledged(line)
        if swallowed is None:
            fault.hit -= 1
            return [line]
        answer, instead = swallowed
        self._send("host", answer)
        return [instead]

    def _release(self, now_s: float) -> None:
        for item in [item for item in self._late if item[0] <= now_s]:
            self._late.remove(item)
            self._send(*item[1:])
        stalls = [one for one in self.faults if one.kind == "stall" and one.is_on(self.seen, now_s)]
        held = {way for one in stalls for way in ("host", "device") if one.way in (way, "both")}
        waiting, self._stalled = self._stalled, [one for one in self._stalled if one[0] in held]
        for way, line in waiting:
            if way not in held:
                self._send(way, line)

    def _send(self, way: Way, data: bytes) -> None:
        if way == "host":
            self.delivered += data
        elif isinstance(data, Unit):
            self.heard_s, self.written_s = self._clock(), data.written_s
        (self.near if way == "host" else self.far).write(data)
