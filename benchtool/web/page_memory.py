"""What outlives a page: messages with their times, and what was typed into forms."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from benchtool.core.errors import BenchtoolError
from benchtool.data.run.state import recall_latest, store_state

MAX_MESSAGES = 200  # The log holds so many, the newest; a choice
MAX_TABS = 20  # The forms of so many browser tabs are remembered, those used last; a choice
WRITE_AFTER_S = 0.5  # Forms are written so long after a change, several changes together; a choice


@dataclass(frozen=True, slots=True)
class LoggedMessage:
    """Hold one message of the log; `count` of the same text came one after another."""

    at: datetime
    text: str
    is_error: bool
    count: int = 1


class MessageHistory:
    """Hold the messages that pages have shown, with times; the same text in a row stands once."""

    def __init__(self, now: Callable[[], datetime] = lambda: datetime.now().astimezone()) -> None:
        self._now = now
        self.messages: deque[LoggedMessage] = deque(maxlen=MAX_MESSAGES)

    def add(self, text: str, *, is_error: bool = False) -> None:
        count = 1
        if self.messages and self.messages[-1].text == text:
            count += self.messages.pop().count
        self.messages.append(LoggedMessage(self._now(), text, is_error, count))


class FormState:
    """Remember what was typed into the forms of each browser tab, also when the server ends.

    Args:
        runs: folder of the server; servers of other folders have forms of their own.
    """

    def __init__(self, runs: Path) -> None:
        self._name = str(runs.absolute())
        self._pending = False
        self._tabs: dict[str, dict[str, Any]] = {}
        with suppress(BenchtoolError):  # a file that cannot be read costs what was typed, no more
            self._tabs = recall_latest("page", self._name) or {}

    def values(self, tab: str) -> dict[str, Any]:
        """Return what was typed in a browser tab, by field."""
        found = self._tabs.get(tab)
        return found if isinstance(found, dict) else {}

    def note(self, tab: str, field: str, value: Any) -> None:
        """Remember a field's value; written a moment later."""
        values = self.values(tab)
        self._tabs.pop(tab, None)
        self._tabs[tab] = {**values, field: value}
        for old in list(self._tabs)[:-MAX_TABS]:
            del self._tabs[old]
        if not self._pending:
            self._pending = True
            asyncio.get_running_loop().call_later(WRITE_AFTER_S, self.write)

    def write(self) -> None:
        """Write what has changed."""
        if self._pending:
            self._pending = False
            with suppress(BenchtoolError):
                store_state("page", self._name, self._tabs)
