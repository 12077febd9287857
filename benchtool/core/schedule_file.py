"""Schedules as TOML files: presets that ship, and a user's own."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import tomli_w

from benchtool.core.library import list_names, read_named
from benchtool.core.schedule import Schedule
from benchtool.core.toml_text import read_strict


def schedule_names() -> tuple[str, ...]:
    """Return the names of the schedules that benchtool ships."""
    return list_names("schedules")


def load_schedule(name_or_path: str | Path) -> Schedule:
    """Return a shipped schedule by name, or a user's own by the path of its TOML file."""
    return read_strict(Schedule, *read_named("schedule", "schedules", name_or_path))


def schedule_to_toml(schedule: Schedule) -> str:
    """Return a schedule as TOML text that reads back to the same schedule."""
    return tomli_w.dumps(_stated(schedule))


def _stated(item: Any) -> dict[str, Any]:
    """Return a table of what is not at its default; parts of a schedule become tables."""
    table: dict[str, Any] = {}
    for own in fields(item):
        value = getattr(item, own.name)
        if value == own.default:
            continue
        if isinstance(value, tuple):
            value = [_stated(part) if is_dataclass(part) else part for part in value]
        table[own.name] = value
    return table
