"""Messages and forms outlive a page."""

from __future__ import annotations

import asyncio
from datetime import UTC, datetime
from pathlib import Path

import pytest

from benchtool.web.page_memory import MOST_TABS, FormMemory, PageMessages


def test_the_same_message_in_a_row_stands_once_with_its_last_time() -> None:
    times = iter(datetime(2026, 1, 1, 12, 0, second, tzinfo=UTC) for second in range(3))
    log = PageMessages(lambda: next(times))
    for text in ("bench lost", "bench lost", "tared"):
        log.add(text, is_error=text != "tared")
    shown = [(one.text, one.count, one.at.second, one.is_error) for one in log.messages]
    assert shown == [("bench lost", 2, 1, True), ("tared", 1, 2, False)]


def test_forms_are_read_by_the_next_server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BENCHTOOL_STATE", str(tmp_path / "state"))

    async def typed() -> None:
        memory = FormMemory(tmp_path / "runs")
        for tab in range(MOST_TABS + 1):
            memory.note(f"tab-{tab}", "fit.model", "single")
        memory.note("tab-1", "fit.data", ["a", "b"])
        memory.write()

    asyncio.run(typed())
    again = FormMemory(tmp_path / "runs")
    assert again.values("tab-1") == {"fit.model": "single", "fit.data": ["a", "b"]}
    assert again.values("tab-0") == {}, "the tab used longest ago is forgotten"
    assert FormMemory(tmp_path / "other").values("tab-1") == {}
