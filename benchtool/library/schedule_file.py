"""Schedules as TOML files: presets that ship, and a user's own."""

from __future__ import annotations

from pathlib import Path

from benchtool.core.schedule import Schedule
from benchtool.core.toml_text import read_strict
from benchtool.library.packaged import packaged_names, read_named


def schedule_names() -> tuple[str, ...]:
    """Return the names of the schedules that benchtool ships."""
    return packaged_names("schedules")


def schedule_named(name_or_path: str | Path) -> Schedule:
    """Return a shipped schedule by name, or a user's own by the path of its TOML file."""
    return read_strict(Schedule, *read_named("schedule", "schedules", name_or_path))
