"""The index of a folder of runs: what was read of each, in an SQLite file of this user's state.

The folders are the truth. A look at them takes a few calls to the system for each entry; only what
has changed since is read again, and a file that is lost or of another version is made anew. A
sweep that is being recorded is never waited for, and readers do not wait for each other.
"""

from __future__ import annotations

import hashlib
import json
import os
import sqlite3
import stat
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import fields
from datetime import datetime
from pathlib import Path
from typing import Any

from benchtool.core.errors import BenchtoolError
from benchtool.data.atomic import make_folder
from benchtool.data.catalogue.entry import SWEEPS, Entry, kind_of
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.data.run.state import state_folder

MAX_DEPTH = 3  # Folders of folders that are looked through for entries; a choice
VERSION = "2 " + " ".join(field.name for field in fields(Entry))  # index of another one is rebuilt
Seen = dict[str, tuple[str, Entry]]  # by name: times of the files, entry

_RUN = ("metadata.json", "points.csv")
_CHANGING: dict[str, tuple[str, ...]] = {
    **dict.fromkeys((*SWEEPS, "pitch recording"), _RUN),
    "fit": ("result.json",),
    "explanation": ("answer.json",),
}
"""Files by kind that may change in place; when another one comes, goes or is replaced, the folder
itself changes."""


def list_entries(folder: RunsFolder, seen: Seen | None = None) -> tuple[Entry, ...]:
    """Return everything in a runs folder, the newest first; a folder that is not there is empty.

    Args:
        seen: what was read before, brought up to date; only what has changed is read again.
    """
    seen = {} if seen is None else seen
    if not folder.root.is_dir():
        seen.clear()
        return ()
    found = list(_Look(folder, seen).through(str(folder.root), MAX_DEPTH))
    names = {entry.name for entry in found}
    for gone in seen.keys() - names:
        del seen[gone]
    dated = [entry for entry in found if entry.started is not None]
    dated.sort(key=lambda entry: entry.started.timestamp() if entry.started else 0.0, reverse=True)
    undated = sorted((entry for entry in found if entry.started is None), key=lambda e: e.name)
    return (*dated, *undated)


class _Look:
    """Look once through a folder."""

    def __init__(self, folder: RunsFolder, seen: Seen) -> None:
        self._folder, self._seen = folder, seen
        self._root = f"{folder.root}{os.sep}"
        self._within: dict[str, list[str]] = {}
        for name in seen:
            if "/recalibrated-" in name:
                self._within.setdefault(name.rpartition("/")[0], []).append(name)

    def through(self, path: str, depth: int) -> Iterator[Entry]:
        with os.scandir(path) as items:
            there = sorted((item.name, item.is_symlink()) for item in items)
        for own, linked in there:
            if own.startswith("."):
                continue
            item = os.path.join(path, own)
            name = item[len(self._root) :].replace(os.sep, "/")
            known = None if linked else self._seen.get(name)
            if known and known[0] == _stamp(item, known[1].kind):
                yield known[1]
                for inner in self._within.get(name, ()):
                    yield self._entry(inner, f"{self._root}{inner}")
            else:
                yield from self._read(name, Path(item), depth, linked)

    def _read(self, name: str, item: Path, depth: int, linked: bool) -> Iterator[Entry]:
        known = "" if linked else kind_of(item)
        try:
            if known or linked:  # of any other folder, what is in it is checked
                self._folder.path_of(name)
        except BenchtoolError as error:
            if item.is_dir() or linked:
                yield Entry(name=name, kind="unknown", problem=str(error))
            return
        known = known or kind_of(item)
        if known:
            yield self._entry(name, str(item))
            within = item.glob("recalibrated-*") if known == "sweep" else ()
            for inner in sorted(within):
                yield self._entry(self._folder.name_of(inner), str(inner))
        elif item.is_dir():
            inside = (
                list(self.through(os.path.join(self._root, name), depth - 1)) if depth > 1 else []
            )
            yield from inside or [self._entry(name, str(item))]

    def _entry(self, name: str, path: str) -> Entry:
        """Return one entry, read again only where one of its files has changed."""
        stamp = _stamp(path, kind_of(Path(path)))
        if name not in self._seen or self._seen[name][0] != stamp:
            from benchtool.data.run.entry import build_entry

            self._seen[name] = (stamp, build_entry(self._folder, name))
        return self._seen[name][1]


def _stamp(path: str, kind: str) -> str:
    """Return what changes when something of an entry of a kind does."""
    own = os.lstat(path)
    stamps = [own.st_mtime_ns, own.st_size]
    folder = stat.S_ISDIR(own.st_mode)
    others = [f"{path}/{file}" for file in _CHANGING.get(kind, ())] if folder else [f"{path}.json"]
    for other in others:
        with suppress(OSError):
            one = os.lstat(other)
            stamps += [one.st_mtime_ns, one.st_size]
    return " ".join(map(str, stamps))


def index_folder(root: Path) -> Path:
    """Return the folder in which the index of a folder of runs lies; it need not exist."""
    key = hashlib.sha256(os.fsencode(root.resolve())).hexdigest()[:16]
    return state_folder() / "catalogue" / key


def catalogued(root: Path, *, rebuild: bool = False) -> tuple[Entry, ...]:
    """Return everything in a folder of runs, the newest first, through its index.

    Args:
        rebuild: read every entry again, whatever the index says.

    Raises:
        OSError: the index cannot be written.
    """
    folder = RunsFolder(root)
    with closing(_connect(index_folder(root))) as store:
        seen = {} if rebuild else _stored(store)
        before = dict(seen)
        entries = list_entries(folder, seen)
        changed = {name: one for name, one in seen.items() if before.get(name) is not one}
        gone = [name for name in before if name not in seen]
        if rebuild or changed or gone:
            with store:  # one transaction
                if rebuild:
                    store.execute("DELETE FROM entry")
                store.executemany("DELETE FROM entry WHERE name = ?", [(name,) for name in gone])
                rows = [(name, stamp, _text(one)) for name, (stamp, one) in changed.items()]
                store.executemany("INSERT OR REPLACE INTO entry VALUES (?, ?, ?)", rows)
    return entries


def _connect(folder: Path) -> sqlite3.Connection:
    """Open the index; one that is broken or of another version is replaced by an empty one."""
    make_folder(folder)
    path = folder / "index.sqlite"
    try:
        return _opened(path)
    except sqlite3.DatabaseError as error:
        if isinstance(error, sqlite3.OperationalError):
            raise
        for name in (path, *(path.with_name(path.name + end) for end in ("-wal", "-shm"))):
            name.unlink(missing_ok=True)
        return _opened(path)


def _opened(path: Path) -> sqlite3.Connection:
    store = sqlite3.connect(path, timeout=30.0)
    try:
        store.execute("PRAGMA journal_mode = WAL")
        store.execute("PRAGMA synchronous = NORMAL")
        store.execute("CREATE TABLE IF NOT EXISTS version (text TEXT)")
        if store.execute("SELECT text FROM version").fetchall() != [(VERSION,)]:
            with store:
                store.execute("BEGIN IMMEDIATE")  # another process may begin the same index
                store.execute("DROP TABLE IF EXISTS entry")
                store.execute("DELETE FROM version")
                store.execute("CREATE TABLE entry (name TEXT PRIMARY KEY, stamp TEXT, text TEXT)")
                store.execute("INSERT INTO version VALUES (?)", (VERSION,))
    except BaseException:
        store.close()
        raise
    return store


def _text(entry: Entry) -> str:
    """Return an entry as JSON, without what is as the default says."""
    values = {field.name: getattr(entry, field.name) for field in fields(Entry)}
    values = {name: value for name, value in values.items() if value not in ("", None, ())}
    return json.dumps(values, default=datetime.isoformat)


def _stored(store: sqlite3.Connection) -> Seen:
    rows = store.execute("SELECT name, stamp, text FROM entry").fetchall()
    parsed = json.loads(f"[{','.join(row[2] for row in rows)}]")
    return {row[0]: (row[1], _entry(one)) for row, one in zip(rows, parsed, strict=True)}


def _entry(values: dict[str, Any]) -> Entry:
    if "started" in values:
        values["started"] = datetime.fromisoformat(values["started"])
    for name in ("z_over_r", "tags", "notes"):
        if name in values:
            values[name] = tuple(values[name])
    if "values" in values:
        values["values"] = tuple((name, value) for name, value in values["values"])
    return Entry(**values)
