"""Conversations recorded with ArduCopter 4.6.2, for our driver and the virtual autopilot."""

from __future__ import annotations

import gzip
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from benchtool.bench.mavlink.frames import Message, dialect

STEP_S = 0.005
WAITED_FOR = ("COMMAND_LONG", "PARAM_REQUEST_READ")


@dataclass(frozen=True, slots=True)
class Chunk:
    """One piece of a conversation, as it went over the link."""

    time_s: float
    host: bool
    data: bytes


def folder_of(reference_data: Path) -> Path:
    """Give the folder of recorded conversations, or skip the test where there is none."""
    folder = reference_data.parent / "peers" / "ardupilot"
    if not folder.is_dir():
        pytest.skip(f"{folder} with recorded conversations is absent")
    return folder


def names_of() -> list[str]:
    """Return the names of the conversations; none where there are no recordings."""
    data = os.environ.get("BENCHTOOL_REFERENCE_DATA")
    files = Path(data).parent.glob("peers/ardupilot/*.jsonl.gz") if data else ()
    return sorted(path.name.removesuffix(".jsonl.gz") for path in files)


def facts_of(folder: Path) -> dict[str, Any]:
    """Give what was noted of each conversation."""
    found: dict[str, Any] = json.loads((folder / "conversations.json").read_text())
    return found


def chunks_of(folder: Path, name: str) -> list[Chunk]:
    """Give a conversation; what only the companion's own port carried is left out."""
    with gzip.open(folder / f"{name}.jsonl.gz", "rt") as lines:
        told = [json.loads(line) for line in lines]
    return [
        Chunk(line["t"], line["from"] == "host", bytes.fromhex(line["hex"]))
        for line in told
        if "to" not in line and line["from"] in ("host", "autopilot")
    ]


def messages_of(data: bytes, parser: Any) -> list[Message]:
    """Give the messages that bytes complete, without what is no frame."""
    found = parser.parse_buffer(data) or []
    return [message for message in found if message.get_type() != "BAD_DATA"]


def parser_of() -> Any:
    """Give a parser that passes over what is no frame."""
    parser = dialect().MAVLink(None)
    parser.robust_parsing = True
    return parser


def asked_in(messages: list[Message]) -> list[tuple[object, ...]]:
    """Give what a host asks for, each as what must be the same in a replay."""
    found: list[tuple[object, ...]] = []
    for message in messages:
        if message.get_type() == "COMMAND_LONG":
            found.append((message.command, message.param1, round(message.param3), message.param4))
        elif message.get_type() == "PARAM_REQUEST_READ":
            found.append((message.param_id,))
    return found


class RecordedPeer:
    """A transport on a virtual clock that answers as the recorded autopilot did.

    Everything up to the next thing that the recorded host asked is said at its time; then the peer
    waits until our host asks the same, for as long as the conversation is not free of it.

    Attributes:
        said_s: when the autopilot said something last.
        sent: what our host has sent, and when.
        skipped: what was passed over because our host did not ask it.

    Args:
        chunks: the conversation.
        free_after_s: from this recorded time on the autopilot speaks whatever the host asks.
        patience_s: what the recorded host asked and ours does not is passed over after so long.
    """

    baud: int | None = None

    def __init__(
        self, chunks: list[Chunk], free_after_s: float = 1e9, patience_s: float = 0.5
    ) -> None:
        self.now_s = self.said_s = 0.0
        self.sent: list[tuple[float, Message]] = []
        self.skipped: list[tuple[object, ...]] = []
        self._host, self._parser = parser_of(), parser_of()
        self._chunks, self._at = chunks, 0
        self._asks = [asked_in(messages_of(c.data, self._host)) if c.host else [] for c in chunks]
        self._free_after_s, self._patience_s = free_after_s, patience_s
        # A companion may have spoken long before the host came.
        self._behind_s = -next((chunk.time_s for chunk in chunks if chunk.host), 0.0)
        self._wanted: list[tuple[object, ...]] = []
        self._last: tuple[object, ...] = ()
        self._asked: list[tuple[object, ...]] = []
        self._waiting_since_s: float | None = None

    @property
    def over(self) -> bool:
        """Whether the recording has come to its end."""
        return self._at == len(self._chunks)

    def clock(self) -> float:
        """Return the virtual time in seconds."""
        return self.now_s

    def open(self) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""

    def write(self, data: bytes) -> None:
        for message in messages_of(data, self._parser):
            self.sent.append((self.now_s, message))
            self._asked += asked_in([message])

    def read(self, timeout_s: float) -> bytes:
        self.now_s += max(min(timeout_s, STEP_S), 1e-6)
        said = b""
        self._catch_up()
        while not self.over:
            chunk = self._chunks[self._at]
            if chunk.time_s < self._free_after_s and not self._answered():
                return said
            if self.now_s < chunk.time_s + self._behind_s:
                return said
            if not chunk.host:
                said += chunk.data
                self.said_s = self.now_s
            elif chunk.time_s < self._free_after_s:
                self._wanted += self._asks[self._at]
            self._at += 1
        return said

    def _catch_up(self) -> None:
        """Let time pass faster where our host has asked sooner than the recorded one."""
        for at in range(self._at, len(self._chunks)):
            for ask in self._asks[at]:
                if ask != self._last and ask in self._asked:
                    time_s = self._chunks[at].time_s
                    self._behind_s = min(self._behind_s, self.now_s - time_s)
                return

    def _answered(self) -> bool:
        """Take off what our host has asked meanwhile; tell whether nothing is waited for."""
        while self._wanted and self._wanted[0] in self._asked:
            self._forget()
        if not self._wanted:
            return True
        if self._waiting_since_s is None:
            self._waiting_since_s = self.now_s
        if self.now_s - self._waiting_since_s >= self._patience_s:
            self.skipped.append(self._wanted[0])
            self._forget()
        return not self._wanted

    def _forget(self) -> None:
        """Take off what was waited for; what follows comes as much later as it was waited."""
        self._last = self._wanted.pop(0)
        if self._last in self._asked:
            self._asked.remove(self._last)
        if self._waiting_since_s is not None:
            self._behind_s += self.now_s - self._waiting_since_s
        self._waiting_since_s = None


def texts_of(facts: dict[str, Any]) -> Iterator[tuple[int, int, str]]:
    """Give severity, component and words of every text of every conversation."""
    for told in facts.values():
        for _, severity, _, component, text in told["texts"]:
            yield severity, component, text
