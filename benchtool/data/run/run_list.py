"""What a runs folder holds, as a list to search: runs, fits, explanations, tables, what broke."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from benchtool.core.errors import BenchtoolError
from benchtool.data.run.entry import Entry, entry_of, kind_of
from benchtool.data.run.recording_file import beside
from benchtool.data.run.runs_folder import RunsFolder

DEEPEST = 3
"""Folders of folders that are looked through for entries; a choice."""


Seen = dict[str, tuple[int, Entry]]
"""Entries by name as they were read last, with the newest time of their files."""


def list_entries(folder: RunsFolder, seen: Seen | None = None) -> tuple[Entry, ...]:
    """Return everything in a runs folder, the newest first; a folder that is not there is empty.

    Args:
        folder: of runs.
        seen: kept between calls, so that only what has changed is read again.
    """
    if not folder.root.is_dir():
        return ()
    found = list(_in_folder(folder, folder.root, DEEPEST, {} if seen is None else seen))
    dated = [entry for entry in found if entry.started is not None]
    dated.sort(key=_age, reverse=True)
    undated = sorted((entry for entry in found if entry.started is None), key=lambda e: e.name)
    return (*dated, *undated)


def search(entries: Iterable[Entry], words: str = "", kind: str = "") -> tuple[Entry, ...]:
    """Return the entries that answer to some words and are of a kind; of any where none is said."""
    return tuple(
        entry for entry in entries if (not kind or entry.kind == kind) and entry.answers(words)
    )


def _in_folder(folder: RunsFolder, path: Path, depth: int, seen: Seen) -> Iterator[Entry]:
    for item in sorted(path.iterdir()):
        if item.name.startswith("."):
            continue
        name = folder.name_of(item)
        try:
            folder.path_of(name)
        except BenchtoolError as error:
            if item.is_dir() or item.is_symlink():
                yield Entry(name=name, kind="unknown", problem=str(error))
            continue
        known = kind_of(item)
        if known:
            yield _entry(folder, item, seen)
            within = item.glob("recalibrated-*") if known == "sweep" else ()
            yield from (_entry(folder, inner, seen) for inner in sorted(within))
        elif item.is_dir():
            inside = list(_in_folder(folder, item, depth - 1, seen)) if depth > 1 else []
            yield from inside or [_entry(folder, item, seen)]


def _entry(folder: RunsFolder, path: Path, seen: Seen) -> Entry:
    """Return one entry, read again only where one of its files has changed."""
    name = folder.name_of(path)
    files = [path, *path.iterdir()] if path.is_dir() else [path, beside(path)]
    stamp = max(os.lstat(file).st_mtime_ns for file in files if os.path.lexists(file))
    if name not in seen or seen[name][0] != stamp:
        seen[name] = (stamp, entry_of(folder, name))
    return seen[name][1]


def _age(entry: Entry) -> float:
    return entry.started.timestamp() if entry.started else 0.0
