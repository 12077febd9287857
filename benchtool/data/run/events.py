"""events.jsonl: what happened during a run, one JSON object a line."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

from benchtool.core.errors import InputError
from benchtool.core.parsed_text import parse_json
from benchtool.core.toml_text import build
from benchtool.core.user_file import MOST_FACTS_BYTES, read_text
from benchtool.data.run.append import AppendFile


@dataclass(frozen=True, slots=True)
class Event:
    """Say that something happened.

    Attributes:
        time_s: since the run began, on the bench's clock.
        event: what, in one word ("settle_timeout", "tare", "stopped", "device").
        text: one sentence for people.
        point: number of the visit, 0 for none.
        wall: date and time with the offset from UTC.
    """

    time_s: float
    event: str
    text: str
    point: int = 0
    wall: str = ""


class EventLog:
    """Append events; an event is on the disk when `append` returns."""

    def __init__(self, path: Path) -> None:
        self.file = AppendFile(path)

    def append(self, event: Event) -> None:
        """Append one event, stamped with the wall clock."""
        data = asdict(event)
        data["wall"] = event.wall or datetime.now(UTC).isoformat(timespec="milliseconds")
        self.file.write(json.dumps(data, ensure_ascii=False).encode() + b"\n")
        self.file.sync()

    def close(self) -> None:
        """Close the file; safe to call twice."""
        self.file.close()


def read_events(path: Path) -> tuple[Event, ...]:
    """Return the events of a run, oldest first; a line that is no event is left out."""
    if not os.path.lexists(path):
        return ()
    events = []
    for line in read_text(path, MOST_FACTS_BYTES, follow=False).splitlines():
        try:
            events.append(build(Event, parse_json(line, str(path)), str(path)))
        except InputError:
            continue
    return tuple(events)
