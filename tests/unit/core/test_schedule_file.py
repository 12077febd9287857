"""Schedules as text read back to the same schedule."""

from __future__ import annotations

import pytest

from benchtool.core.schedule import Schedule
from benchtool.core.schedule_file import load_schedule, schedule_names, schedule_to_toml
from benchtool.core.toml_text import read_strict


@pytest.mark.parametrize("name", schedule_names())
def test_every_shipped_schedule_comes_back(name):
    schedule = load_schedule(name)
    assert read_strict(Schedule, schedule_to_toml(schedule), name) == schedule
