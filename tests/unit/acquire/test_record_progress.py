"""Time left of a sweep, in real seconds whatever the bench's clock does."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from benchtool.acquire import record
from benchtool.acquire.record import RunProgress, SafeProgress


@pytest.mark.parametrize(
    ("real_s", "left_s"),
    [(0.4, 1.0), (4.0, 10.0), (40.0, 100.0), (400.0, 100.0)],
)
def test_time_left_is_real(real_s: float, left_s: float, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[float] = []

    class Watcher(RunProgress):
        def measured(self, point: Any, remaining_s: float) -> None:
            said.append(remaining_s)

    now = iter((1000.0, 1000.0 + real_s))
    monkeypatch.setattr(record, "monotonic", lambda: next(now))
    progress = SafeProgress(Watcher())
    for time_s in (5.0, 45.0):
        progress.measured(SimpleNamespace(time_s=time_s), 100.0)  # type: ignore[arg-type]
    assert said == [100.0, pytest.approx(left_s)]
