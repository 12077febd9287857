"""Schedules as TOML files, bundled or user-defined."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import tomli_w

from benchtool.core.library import list_names, read_library_file
from benchtool.core.schedule import Schedule
from benchtool.core.toml_text import read_strict


def schedule_names() -> tuple[str, ...]:
    """Return the names of the bundled schedules."""
    return list_names("schedules")


def load_schedule(name_or_path: str | Path) -> Schedule:
    """Return a bundled schedule by name, or a user-defined one by the path of its TOML file."""
    return read_strict(Schedule, *read_library_file("schedule", "schedules", name_or_path))


def schedule_to_toml(schedule: Schedule) -> str:
    """Return a schedule as TOML text; parsing it gives the same schedule."""
    return tomli_w.dumps(_non_default_values(schedule))


def _non_default_values(item: Any) -> dict[str, Any]:
    """Return a table of the values that differ from their defaults; nested parts become tables."""
    table: dict[str, Any] = {}
    for field in fields(item):
        value = getattr(item, field.name)
        if value == field.default:
            continue
        if isinstance(value, tuple):
            value = [_non_default_values(part) if is_dataclass(part) else part for part in value]
        table[field.name] = value
    return table
