"""Runs folder, and safe resolution of user-supplied names to paths in it.

A name with "..", an absolute path, or a symbolic link out of the folder, on the path or below it,
is rejected before a file is opened.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath

from benchtool.core.errors import FileFormatError, InputError, WouldOverwrite, check_name

MAX_DEPTH = 6  # levels of folders checked below a name; a run has two; assumed
MAX_NAME_LENGTH = 200  # characters in one part of a name; file systems allow 255 bytes


@dataclass(frozen=True, slots=True)
class RunsFolder:
    """Folder of runs that resolves names to paths inside it."""

    root: Path  # the folder; it may not exist yet

    def find_path(self, name: str) -> Path:
        """Return the path of an existing run or file, with its links checked.

        `name` is relative, parts separated by "/", as from `relative_name`.
        """
        path = self.resolve(name)
        if not path.exists():
            raise FileFormatError(name, "it is not in the runs folder; choose one that is listed")
        self._check_links(path, name)
        return path

    def find_file(self, name: str) -> Path:
        """Return the path of an existing file; checks as in `find_path`."""
        path = self.find_path(name)
        if not path.is_file():
            raise FileFormatError(name, "it is not a file; choose a file")
        return path

    def new_path(self, name: str) -> Path:
        """Return the path of a new run, without creating it."""
        check_name("run", name, ascii_only=True)
        path = self.resolve(name)
        if os.path.lexists(path):
            raise WouldOverwrite(name)
        return path

    def free_path(self, date: str, name: str) -> Path:
        """Return DATE-NAME, with suffix -2, -3, ... if that path exists."""
        from benchtool.data.run.run import free_run_path

        return self.new_path(free_run_path(self.root, date, name).name)

    def relative_name(self, path: Path) -> str:
        """Return the name of a path in this folder."""
        return path.relative_to(self.root).as_posix()

    def resolve(self, name: str) -> Path:
        """Return root/name, existing or not; raise if it is outside the folder."""
        parts = name.split("/")
        is_invalid = (
            "\0" in name
            or "\\" in name
            or PurePosixPath(name).is_absolute()
            or PureWindowsPath(name).drive != ""
            or any(not part or part.startswith(".") for part in parts)
            or max(map(len, parts)) > MAX_NAME_LENGTH
        )
        path = self.root.joinpath(*parts) if not is_invalid else self.root
        if is_invalid or not _is_below(path, self.root):
            raise InputError(
                f"{name[:80]!r} is outside the runs folder and cannot be read or written; choose "
                f"a listed name"
            )
        return path

    def _check_links(self, path: Path, name: str) -> None:
        for item in _walk(path, MAX_DEPTH):
            if item.is_symlink() and not _is_below(item, self.root):
                raise InputError(
                    f"{name}: {item.name} is a link to a path outside the runs folder, which is "
                    f"not followed; replace the link with the file"
                )
            try:
                mode = item.stat().st_mode
            except FileNotFoundError:
                continue  # replaced by the program that measures the run
            if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
                raise InputError(
                    f"{name}: {item.name} is neither a file nor a folder; remove it from there"
                )


def _is_below(path: Path, root: Path) -> bool:
    """Return whether a path is below a folder after links are resolved."""
    try:
        resolved, resolved_root = path.resolve(), root.resolve()
    except (OSError, RuntimeError):  # cyclic links
        return False
    return resolved != resolved_root and resolved.is_relative_to(resolved_root)


def _walk(path: Path, depth: int) -> Iterator[Path]:
    """Yield a path and all paths below it; links are yielded but not followed."""
    yield path
    if depth and path.is_dir():
        for item in sorted(path.iterdir()):
            if item.is_symlink():
                yield item
            else:
                yield from _walk(item, depth - 1)


MAX_UPLOAD_BYTES = 20_000_000  # a table of points has a few kilobytes, a log more; assumed
MAX_COLUMNS = 500


def store_table(folder: RunsFolder, name: str, data: bytes, date: str) -> Path:
    """Check an uploaded table, write it to a new folder of the runs folder and return its path.

    `name` is that of the uploaded file; only ASCII letters, digits, _ and - are kept.
    """
    from benchtool.data.atomic import sync_folder
    from benchtool.data.csv_text import empty_table_error, parse_csv

    where = upload_name(name)
    if len(data) > MAX_UPLOAD_BYTES:
        raise FileFormatError(
            where,
            f"it has {len(data) / 1e6:.1f} MB; allowed: {MAX_UPLOAD_BYTES / 1e6:.0f} MB; shorten "
            f"it, or copy it to the runs folder",
        )
    table = parse_csv(data, where)
    if len(table.header) > MAX_COLUMNS:
        raise FileFormatError(
            where,
            f"it has {len(table.header)} columns; allowed: {MAX_COLUMNS}; keep only the columns "
            f"needed for a fit",
        )
    if not len(table.rows):
        raise empty_table_error(where, table.header)
    path = create_table_path(folder, name, date)
    path.write_bytes(data)
    sync_folder(path.parent)
    return path


def upload_name(name: str) -> str:
    """Return the name of an uploaded file for messages, without folders."""
    return re.split(r"[/\\]", name)[-1][:80] or "the file"


def create_table_path(folder: RunsFolder, name: str, date: str) -> Path:
    """Create a folder DATE-NAME and return the path in it for the table of an uploaded file."""
    stem = re.sub(r"[^A-Za-z0-9_-]+", "-", Path(upload_name(name)).stem).strip("-_")[:60] or "table"
    new_folder = folder.free_path(date, stem)
    new_folder.mkdir(parents=True)
    return new_folder / f"{stem}.csv"


def column_map_path(table: Path) -> Path:
    """Return the path of a table's column map."""
    return table.with_name(f"{table.stem}.columns.toml")
