"""Message history and form values, which survive a page reload."""

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
from benchtool.data.run.state import load_state, store_state

MAX_MESSAGES = 200  # older messages are dropped; assumed
MAX_TABS = 20  # form values of tabs used longer ago are dropped; assumed
WRITE_DELAY_S = 0.5  # after a form change, to write several changes together; assumed


@dataclass(frozen=True, slots=True)
class LoggedMessage:
    """Logged message; `count` is the number of consecutive duplicates."""

    time: datetime
    text: str
    is_error: bool
    count: int = 1


class MessageHistory:
    """Message history with times; consecutive duplicates are stored once."""

    def __init__(self, now: Callable[[], datetime] = lambda: datetime.now().astimezone()) -> None:
        self._now = now
        self.messages: deque[LoggedMessage] = deque(maxlen=MAX_MESSAGES)

    def add(self, text: str, *, is_error: bool = False) -> None:
        count = 1
        if self.messages and self.messages[-1].text == text:
            count += self.messages.pop().count
        self.messages.append(LoggedMessage(self._now(), text, is_error, count))


class FormState:
    """Form values of each browser tab, stored on disk per runs folder."""

    def __init__(self, runs: Path) -> None:
        self._name = str(runs.absolute())
        self._pending = False
        self._tabs: dict[str, dict[str, Any]] = {}
        with suppress(BenchtoolError):  # an unreadable file loses only form values
            self._tabs = load_state("page", self._name) or {}

    def values(self, tab: str) -> dict[str, Any]:
        """Return the form values of a browser tab by field name."""
        values = self._tabs.get(tab)
        return values if isinstance(values, dict) else {}

    def store(self, tab: str, field: str, value: Any) -> None:
        """Store a field's value and schedule the write."""
        values = self.values(tab)
        self._tabs.pop(tab, None)
        self._tabs[tab] = {**values, field: value}
        for old_tab in list(self._tabs)[:-MAX_TABS]:
            del self._tabs[old_tab]
        if not self._pending:
            self._pending = True
            asyncio.get_running_loop().call_later(WRITE_DELAY_S, self.write)

    def write(self) -> None:
        """Write pending changes."""
        if self._pending:
            self._pending = False
            with suppress(BenchtoolError):
                store_state("page", self._name, self._tabs)
