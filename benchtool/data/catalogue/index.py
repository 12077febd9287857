"""Index of a runs folder: cached catalogue entries in an SQLite file of the state folder.

Each use compares the file times of all entries, a few system calls per entry, and reads only
changed entries again. A missing index or one of another version is rebuilt. Readers wait neither
for each other nor for a running sweep.
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
from math import inf
from pathlib import Path
from typing import Any
from zlib import crc32

from benchtool.core.errors import BenchtoolError, InputError
from benchtool.data.atomic import make_folder
from benchtool.data.catalogue.entry import SWEEPS, ChoiceInputs, Entry, detect_kind, filter_entries
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.data.run.state import state_folder

MAX_DEPTH = 3  # levels of folders searched for entries; assumed
FIELDS = [field.name for field in fields(Entry)]
# An index of another version is rebuilt; SQLite stores 31 bits of it.
VERSION = crc32(" ".join(("3", *FIELDS)).encode()) >> 1
CachedEntries = dict[str, tuple[str, Entry]]  # by name: stamp of the files, entry

_RUN = ("metadata.json", "points.csv")
# Files that change in place, by kind; adding, removing or replacing a file changes the folder.
_MUTABLE_FILES: dict[str, tuple[str, ...]] = {
    **dict.fromkeys((*SWEEPS, "pitch recording"), _RUN),
    "fit": ("result.json",),
    "explanation": ("answer.json",),
}


def list_entries(folder: RunsFolder, cache: CachedEntries | None = None) -> tuple[Entry, ...]:
    """Return all entries of a runs folder, newest first; () if the folder does not exist.

    `cache` has the entries of the last call, updated in place; only changed entries are read.
    """
    cache = {} if cache is None else cache
    if not folder.root.is_dir():
        cache.clear()
        return ()
    entries = list(_FolderScan(folder, cache).scan(str(folder.root), MAX_DEPTH))
    for name in cache.keys() - {entry.name for entry in entries}:
        del cache[name]
    entries.sort(key=lambda e: (-e.started.timestamp(), "") if e.started else (inf, e.name))
    return tuple(entries)


class _FolderScan:
    """Scan of a runs folder with cached entries."""

    def __init__(self, folder: RunsFolder, cache: CachedEntries) -> None:
        self._folder, self._cache = folder, cache
        self._root = f"{folder.root}{os.sep}"
        self._recalibrated: dict[str, list[str]] = {}
        for name in cache:
            if "/recalibrated-" in name:
                self._recalibrated.setdefault(name.rpartition("/")[0], []).append(name)

    def scan(self, path: str, depth: int) -> Iterator[Entry]:
        with os.scandir(path) as items:
            file_names = sorted((item.name, item.is_symlink()) for item in items)
        for file_name, is_link in file_names:
            if file_name.startswith("."):
                continue
            item = os.path.join(path, file_name)
            name = item[len(self._root) :].replace(os.sep, "/")
            cached = None if is_link else self._cache.get(name)
            if cached and cached[0] == _stamp(item, cached[1].kind):
                yield cached[1]
                for inner in self._recalibrated.get(name, ()):
                    yield self._entry(inner, f"{self._root}{inner}")
            else:
                yield from self._read(name, Path(item), depth, is_link)

    def _read(self, name: str, item: Path, depth: int, is_link: bool) -> Iterator[Entry]:
        kind = "" if is_link else detect_kind(item)
        try:
            if kind or is_link:  # the contents of other folders are checked one by one
                self._folder.find_path(name)
        except BenchtoolError as error:
            if item.is_dir() or is_link:
                yield Entry(name=name, kind="unknown", problem=str(error))
            return
        kind = kind or detect_kind(item)
        if kind:
            yield self._entry(name, str(item))
            recalibrated = item.glob("recalibrated-*") if kind == "sweep" else ()
            for inner in sorted(recalibrated):
                yield self._entry(self._folder.relative_name(inner), str(inner))
        elif item.is_dir():
            folder = os.path.join(self._root, name)
            entries = list(self.scan(folder, depth - 1)) if depth > 1 else []
            yield from entries or [self._entry(name, str(item))]

    def _entry(self, name: str, path: str) -> Entry:
        """Return an entry; read it only if one of its files has changed."""
        stamp = _stamp(path, detect_kind(Path(path)))
        if name not in self._cache or self._cache[name][0] != stamp:
            from benchtool.data.run.entry import build_entry

            self._cache[name] = (stamp, build_entry(self._folder, name))
        return self._cache[name][1]


def _stamp(path: str, kind: str) -> str:
    """Return times and sizes of the files of an entry as text."""
    status = os.lstat(path)
    numbers = [status.st_mtime_ns, status.st_size]
    is_folder = stat.S_ISDIR(status.st_mode)
    files = [f"{path}/{file}" for file in _MUTABLE_FILES.get(kind, ())]
    for file in files if is_folder else [f"{path}.json"]:
        with suppress(OSError):
            status = os.lstat(file)
            numbers += [status.st_mtime_ns, status.st_size]
    return " ".join(map(str, numbers))


def index_folder(root: Path) -> Path:
    """Return the folder of the index of a runs folder; it may not exist."""
    key = hashlib.sha256(os.fsencode(root.resolve())).hexdigest()[:16]
    return state_folder() / "catalogue" / key


def load_entries(root: Path, *, rebuild: bool = False) -> tuple[Entry, ...]:
    """Return all entries of a runs folder, newest first, and update its index."""
    folder = RunsFolder(root)
    with closing(_open_index(index_folder(root))) as database:
        cache: CachedEntries = {}
        if not rebuild:
            stored = database.execute("SELECT name, stamp, text FROM entry").fetchall()
            tables = json.loads(f"[{','.join(text for *_, text in stored)}]")
            for (name, stamp, _), values in zip(stored, tables, strict=True):
                cache[name] = stamp, _from_json(values)
        before = dict(cache)
        entries = list_entries(folder, cache)
        changed = {name: item for name, item in cache.items() if before.get(name) is not item}
        removed = [(name,) for name in before if name not in cache]
        if rebuild or changed or removed:
            with database:  # one transaction
                if rebuild:
                    database.execute("DELETE FROM entry")
                database.executemany("DELETE FROM entry WHERE name = ?", removed)
                rows = [(name, stamp, _to_json(entry)) for name, (stamp, entry) in changed.items()]
                database.executemany("INSERT OR REPLACE INTO entry VALUES (?, ?, ?)", rows)
    return entries


def find_entries(by: ChoiceInputs, *, rebuild: bool = False) -> list[tuple[Path, Entry]]:
    """Return the selected entries of all folders, each with its path."""
    selected = []
    for root in by.folder:
        if not root.is_dir():
            raise InputError(f"there is no folder {root}; give a folder of runs")
        entries = filter_entries(load_entries(root, rebuild=rebuild), by)
        selected += [(root / entry.name, entry) for entry in entries]
    return selected


def _open_index(folder: Path) -> sqlite3.Connection:
    """Open the index; replace it by an empty one if it is damaged or of another version."""
    make_folder(folder)
    path = folder / "index.sqlite"
    try:
        return _connect(path)
    except sqlite3.DatabaseError as error:
        if isinstance(error, sqlite3.OperationalError):
            raise
        for file in (path, *(path.with_name(path.name + end) for end in ("-wal", "-shm"))):
            file.unlink(missing_ok=True)
        return _connect(path)


def _connect(path: Path) -> sqlite3.Connection:
    database = sqlite3.connect(path, timeout=30.0)
    try:
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("PRAGMA synchronous = NORMAL")
        if database.execute("PRAGMA user_version").fetchone() != (VERSION,):
            with database:
                database.execute("BEGIN IMMEDIATE")  # another process may create the same index
                database.execute("DROP TABLE IF EXISTS entry")
                database.execute(
                    "CREATE TABLE entry (name TEXT PRIMARY KEY, stamp TEXT, text TEXT)"
                )
                database.execute(f"PRAGMA user_version = {VERSION}")
    except BaseException:
        database.close()
        raise
    return database


def _to_json(entry: Entry) -> str:
    values = [getattr(entry, name) for name in FIELDS]
    return json.dumps(values, default=datetime.isoformat)


def _from_json(values: list[Any]) -> Entry:
    entry = dict(zip(FIELDS, values, strict=True))
    entry["started"] = entry["started"] and datetime.fromisoformat(entry["started"])
    for name in ("z_over_r", "tags", "notes"):
        entry[name] = tuple(entry[name])
    entry["values"] = tuple(map(tuple, entry["values"]))
    return Entry(**entry)
