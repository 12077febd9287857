"""Recorded conversations with real Grbl stages: read them, and play the stage's part of one."""

from __future__ import annotations

import gzip
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

from benchtool.core.errors import LinkLost
from tests.doubles.grbl import SETTINGS

CASE_SETTINGS: dict[str, dict[int, float]] = {
    "driver_coarse_steps": {102: 10},
    "driver_generic_settings": {
        20: 0, 24: 25, 25: 500, 26: 250, 100: 250, 101: 250, 102: 250, 110: 500, 111: 500,
        112: 500, 120: 10, 121: 10, 122: 10, 130: 200, 131: 200, 132: 200,
    },
    "driver_hold_slow": {122: 60},
    "driver_hold_very_slow": {122: 10},
    "driver_homing_off": {20: 0, 22: 0},
    "driver_homing_too_long": {25: 500},
    "driver_hard_limit": {21: 1},
    "driver_hard_limit_stays": {21: 1},
    "driver_reports_buffers": {10: 3},
    "driver_reports_inches": {13: 1},
    "driver_reports_wpos": {10: 0},
    "driver_slow_axis": {112: 300},
    "driver_switch_closed_at_connect": {21: 1},
    "hal_homing_off": {20: 0, 22: 0},
}  # fmt: skip
"""What a case's row in the recordings' own notes changes."""

OPEN = b"(the port is opened)"

DWELL = b"G4 P0\n"
"""The host that was recorded waited for its `ok`; today's takes Idle at the target for arrival."""


def names(*begin: str) -> list[str]:
    """Return the names of the recordings that begin so; none where there are no recordings."""
    data = os.environ.get("BENCHTOOL_REFERENCE_DATA")
    files = Path(data).parent.glob("peers/grbl/*.jsonl.gz") if data else ()
    found = (path.name.removesuffix(".jsonl.gz") for path in files)
    return sorted(name for name in found if name.startswith(begin))


def settings_text(case: str, changed: Mapping[int, float] = MappingProxyType({})) -> bytes:
    """Return what the stage of a case answers to `$$`."""
    values = SETTINGS | CASE_SETTINGS.get(case, {}) | changed
    return b"".join(b"$%d=%s\r\n" % (n, f"{v:g}".encode()) for n, v in values.items()) + b"ok\r\n"


@dataclass(frozen=True, slots=True)
class Entry:
    """One line of a recording: time s, who (host, stage, event), bytes or the event's words."""

    t_s: float
    who: str
    data: bytes


@dataclass(frozen=True, slots=True)
class Call:
    """One call to the stage driver: its words, and what it returned or raised."""

    words: str
    outcome: str
    begun_s: float


@dataclass(frozen=True, slots=True)
class Recording:
    """One recorded conversation."""

    name: str
    entries: tuple[Entry, ...]

    @classmethod
    def read(cls, path: Path) -> Recording:
        """Read a recording."""
        found = []
        with gzip.open(path, "rt", encoding="utf-8") as file:
            for line in file:
                told = json.loads(line)
                who = told.get("from", "event")
                text = told.get("event") or told.get("text")
                data = bytes.fromhex(told["hex"]) if "hex" in told else str(text).encode("latin-1")
                found.append(Entry(float(told["t"]), who, data))
        return cls(path.name.removesuffix(".jsonl.gz"), tuple(found))

    @property
    def calls(self) -> list[Call]:
        """The calls that the driver got."""
        told = [(e.t_s, e.data.decode("latin-1")) for e in self.entries if e.who == "event"]
        own = [(t, text[11:]) for t, text in told if text.startswith("benchtool: ")]
        return [
            Call(words, outcome, begun_s)
            for (begun_s, words), (_, outcome) in zip(own[::2], own[1::2], strict=True)
        ]


@dataclass(frozen=True, slots=True)
class Said:
    """A line of the stage: when so many messages of the host were sent, so long after the last."""

    after: int
    delay_s: float
    data: bytes


@dataclass(frozen=True, slots=True)
class Question:
    """A question of the host for the state, and what answered it; empty where nothing did."""

    after: int
    delay_s: float
    answer: bytes
    answered_s: float


class Script:
    """Sort a recording into messages of the host, lines of the stage, and reports it was asked for.

    Opening the port counts as a message of the host.
    """

    def __init__(self, recording: Recording) -> None:
        self.messages: list[bytes] = []
        self.said: list[Said] = []
        self.questions: list[Question] = []
        self.cuts: list[tuple[int, float]] = []
        self._lines: list[bytes] = []
        last_s, rest = 0.0, b""
        for entry in recording.entries:
            since_s = entry.t_s - last_s
            if entry.data == b"benchtool: open":
                self.messages.append(OPEN)
                last_s, rest = entry.t_s, b""
            elif not self.messages:
                continue
            elif entry.data == b"host opened the port":
                # Opening a port throws away what is old.
                self.said = [said for said in self.said if said.after < len(self.messages)]
                rest = b""
            elif entry.who == "event":
                if entry.data.startswith(b"cable pulled"):
                    self.cuts.append((len(self.messages), since_s))
            elif entry.who == "stage":
                *lines, rest = (rest + entry.data).split(b"\n")
                for line in lines:
                    self._hear(line + b"\n", since_s)
            elif entry.data == b"?":
                self.questions.append(Question(len(self.messages), since_s, b"", 0.0))
            elif entry.data == DWELL:
                self._lines.append(entry.data)
            else:
                self.messages.append(entry.data)
                self._lines += [entry.data] if entry.data.endswith(b"\n") else []
                last_s = entry.t_s

    def _hear(self, line: bytes, since_s: float) -> None:
        if b"<" in line or b"|FS" in line or b"|MPos" in line:
            for index in range(len(self.questions) - 1, -1, -1):
                asked = self.questions[index]
                if asked.after == len(self.messages) and not asked.answer:
                    took_s = since_s - asked.delay_s
                    self.questions[index] = replace(asked, answer=line, answered_s=took_s)
                    break
            return
        if line.startswith((b"ok", b"error")):
            if self._lines and self._lines.pop(0) == DWELL:
                return
        elif b"Grbl" in line:
            self._lines.clear()
        self.said.append(Said(len(self.messages), since_s, line))


class RecordedStage:
    """Be the transport at whose far end a recording is played, on a clock of its own.

    Attributes:
        now_s: the clock.
        diverged: what the host sent that it did not send when this was recorded.
    """

    baud = None

    def __init__(self, recording: Recording) -> None:
        self.now_s = 100.0
        self.diverged = b""
        self._script = Script(recording)
        self._settings = settings_text(recording.name)
        self._sent = 0
        self._last_s = self.now_s
        self._waiting: list[tuple[float, bytes]] = []
        self._is_open = False

    def clock(self) -> float:
        """Return the time."""
        return self.now_s

    def open(self) -> None:
        if OPEN not in self._script.messages[self._sent :]:
            self.diverged = OPEN
            return
        self._sent = self._script.messages.index(OPEN, self._sent)
        self._advance()
        self._waiting = [(at_s, line) for at_s, line in self._waiting if at_s >= self.now_s]
        self._is_open = True

    def close(self) -> None:
        self._is_open = False

    def write(self, data: bytes) -> None:
        self._raise_if_cut()
        if data == b"?":
            self._answer()
        elif data == b"$$\n":
            self._waiting.append((self.now_s + 0.04, self._settings))
        elif not self.diverged and self._script.messages[self._sent : self._sent + 1] == [data]:
            self._advance()
        else:
            self.diverged = self.diverged or data

    def read(self, timeout_s: float) -> bytes:
        until_s = self.now_s + timeout_s
        later = [at_s for at_s, _ in self._waiting if at_s > self.now_s]
        if not self._ready():
            self.now_s = min([until_s, *later])
        self._raise_if_cut()
        ready = self._ready()
        self._waiting = [item for item in self._waiting if item[0] > self.now_s]
        return b"".join(line for _, line in ready)

    def _ready(self) -> list[tuple[float, bytes]]:
        return [item for item in self._waiting if item[0] <= self.now_s]

    def _advance(self) -> None:
        """Count a message, and let come what the stage said after it."""
        # What was late is not lost: the host was faster than the one that was recorded.
        self._waiting = [(min(at_s, self.now_s), line) for at_s, line in self._waiting]
        self._sent += 1
        self._last_s = self.now_s
        self._waiting += [
            (self.now_s + said.delay_s, said.data)
            for said in self._script.said
            if said.after == self._sent
        ]

    def _answer(self) -> None:
        if self.diverged:
            return
        here = [asked for asked in self._script.questions if asked.after == self._sent]
        since_s = self.now_s - self._last_s
        before = [asked for asked in here if asked.delay_s <= since_s + 0.05]
        for asked in before[-1:] or here[:1]:
            if asked.answer:
                self._waiting.append((self.now_s + asked.answered_s, asked.answer))

    def _raise_if_cut(self) -> None:
        if not self._is_open:
            raise LinkLost(
                "the link to stage broke (stage is closed; open it first); check "
                "cable and power, then open it again"
            )
        for after, delay_s in self._script.cuts:
            if after == self._sent and self.now_s >= self._last_s + delay_s:
                raise LinkLost("the link to stage broke; check cable and power, then open it again")
