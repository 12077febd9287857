"""What a runs folder holds, as a list to search: runs, fits, explanations, tables, what broke."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from benchtool.errors import BenchtoolError
from benchtool.store.entry import Entry, entry_of, kind_of
from benchtool.store.runs_folder import RunsFolder

DEEPEST = 3
"""Folders of folders that are looked through for entries; a choice."""


def list_entries(folder: RunsFolder) -> tuple[Entry, ...]:
    """Return everything in a runs folder, the newest first; a folder that is not there is empty."""
    if not folder.root.is_dir():
        return ()
    found = list(_in_folder(folder, folder.root, DEEPEST))
    dated = [entry for entry in found if entry.started is not None]
    dated.sort(key=_age, reverse=True)
    undated = sorted((entry for entry in found if entry.started is None), key=lambda e: e.name)
    return (*dated, *undated)


def search(entries: Iterable[Entry], words: str = "", kind: str = "") -> tuple[Entry, ...]:
    """Return the entries that answer to some words and are of a kind; of any where none is said."""
    return tuple(
        entry for entry in entries if (not kind or entry.kind == kind) and entry.answers(words)
    )


def _in_folder(folder: RunsFolder, path: Path, depth: int) -> Iterator[Entry]:
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
            yield entry_of(folder, name)
            within = item.glob("recalibrated-*") if known == "sweep" else ()
            yield from (entry_of(folder, folder.name_of(inner)) for inner in sorted(within))
        elif item.is_dir():
            inside = list(_in_folder(folder, item, depth - 1)) if depth > 1 else []
            yield from inside or [entry_of(folder, name)]


def _age(entry: Entry) -> float:
    return entry.started.timestamp() if entry.started else 0.0
