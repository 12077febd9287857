"""The folder of runs, and the one way from a name that somebody typed to a path in it.

A name never leads out of the folder: not by "..", not by an absolute path, not by a link on the way
or inside what is named. What is named is checked whole before anything of it is opened.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import TYPE_CHECKING

from benchtool.core.errors import FileFormatError, InputError, WouldOverwrite, check_name

if TYPE_CHECKING:
    from benchtool.data.csv_text import CsvTable

MAX_DEPTH = 6  # Folders below a name that are looked through; a run has two. A choice
MAX_NAME_LENGTH = 200  # Characters in one part of a name; file systems take 255 bytes


@dataclass(frozen=True, slots=True)
class RunsFolder:
    """Lead from names to paths in one folder, and nowhere else.

    Attributes:
        root: the folder; it need not exist yet.
    """

    root: Path

    def path_of(self, name: str) -> Path:
        """Return the path of something that is there, its links checked.

        Args:
            name: relative, parts separated by "/", as `name_of` gives it.

        Raises:
            InputError: a name that leads, or holds a link that leads, outside the folder.
            FileFormatError: nothing of that name is there.
        """
        path = self.inside(name)
        if not path.exists():
            raise FileFormatError(name, "it is not in the runs folder; choose one that is listed")
        self._check_links(path, name)
        return path

    def file_of(self, name: str) -> Path:
        """Return the path of a file that is there, checked as `path_of` does."""
        path = self.path_of(name)
        if not path.is_file():
            raise FileFormatError(name, "it is no file; name one")
        return path

    def new_path(self, name: str) -> Path:
        """Return where something new of that name may be written; nothing is written yet.

        Raises:
            InputError: a name that no folder should have.
            WouldOverwrite: something of that name is there.
        """
        check_name("run", name, ascii_only=True)
        path = self.inside(name)
        if os.path.lexists(path):
            raise WouldOverwrite(name)
        return path

    def free_path(self, date: str, name: str) -> Path:
        """Return DATE-NAME, with -2, -3 and so on behind it while that is taken."""
        from benchtool.data.run.run import free_run_path

        return self.new_path(free_run_path(self.root, date, name).name)

    def name_of(self, path: Path) -> str:
        """Return the name by which `path_of` finds a path."""
        return path.relative_to(self.root).as_posix()

    def inside(self, name: str) -> Path:
        """Return root/name, or refuse a name that leads elsewhere, whether it exists or not."""
        parts = name.split("/")
        strange = (
            "\0" in name
            or "\\" in name
            or PurePosixPath(name).is_absolute()
            or PureWindowsPath(name).drive != ""
            or any(not part or part.startswith(".") for part in parts)
            or max(map(len, parts)) > MAX_NAME_LENGTH
        )
        path = self.root.joinpath(*parts) if not strange else self.root
        if strange or not _is_below(path, self.root):
            raise InputError(
                f"{name[:80]!r} leads out of the runs folder, and only what is in it can be read "
                f"or written here; choose a name that is listed"
            )
        return path

    def _check_links(self, path: Path, name: str) -> None:
        for item in _everything(path, MAX_DEPTH):
            if item.is_symlink() and not _is_below(item, self.root):
                raise InputError(
                    f"{name}: {item.name} is a link that leads out of the runs folder, so nothing "
                    f"of it is read; put the file itself there"
                )
            try:
                mode = item.stat().st_mode
            except FileNotFoundError:
                continue  # a run that is being written replaces files
            if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
                raise InputError(
                    f"{name}: {item.name} is neither a file nor a folder; take it out of there"
                )


def _is_below(path: Path, root: Path) -> bool:
    """Return whether a path, every link followed, lies below a folder."""
    try:
        real, top = path.resolve(), root.resolve()
    except (OSError, RuntimeError):  # a ring of links
        return False
    return real != top and real.is_relative_to(top)


def _everything(path: Path, depth: int) -> Iterator[Path]:
    """Yield a path and all below it; links are named and not followed."""
    yield path
    if depth and path.is_dir():
        for item in sorted(path.iterdir()):
            if item.is_symlink():
                yield item
            else:
                yield from _everything(item, depth - 1)


MAX_UPLOAD_BYTES = (
    20_000_000  # A table of points is a few kilobytes; this is room for a log. A choice
)

MAX_COLUMNS = 500


def checked_table(data: bytes, name: str) -> CsvTable:
    """Return the cells of a table that was handed over.

    Raises:
        FileFormatError: too large, no CSV, no row, or more columns than anybody would map.
    """
    from benchtool.data.csv_text import empty_table_error, parse_csv

    if len(data) > MAX_UPLOAD_BYTES:
        raise FileFormatError(
            name,
            f"it has {len(data) / 1e6:.1f} MB, and at most {MAX_UPLOAD_BYTES / 1e6:.0f} MB are "
            f"taken; cut it, or put it into the runs folder yourself",
        )
    table = parse_csv(data, name)
    if len(table.header) > MAX_COLUMNS:
        raise FileFormatError(
            name,
            f"its header names {len(table.header)} columns, and at most {MAX_COLUMNS} are taken; "
            f"keep those of a fit",
        )
    if not table.rows:
        raise empty_table_error(name, table.header)
    return table


def store_table(folder: RunsFolder, name: str, data: bytes, date: str) -> Path:
    """Write a checked table into a folder of its own in the runs folder and return its path.

    Args:
        name: of the file as it was handed over; only letters, digits and a few signs stay.

    Raises:
        FileFormatError: see `checked_table`; nothing was written.
    """
    from benchtool.data.atomic import sync_folder

    checked_table(data, shown_name(name))
    path = new_table(folder, name, date)
    path.write_bytes(data)
    sync_folder(path.parent)
    return path


def shown_name(name: str) -> str:
    """Return what messages call a file that was handed over: its name without folders."""
    return re.split(r"[/\\]", name)[-1][:80] or "the file"


def new_table(folder: RunsFolder, name: str, date: str) -> Path:
    """Make a folder DATE-NAME, and return where the table of a file handed over goes in it."""
    stem = re.sub(r"[^A-Za-z0-9_-]+", "-", Path(shown_name(name)).stem).strip("-_")[:60] or "table"
    place = folder.free_path(date, stem)
    place.mkdir(parents=True)
    return place / f"{stem}.csv"


def columns_file(table: Path) -> Path:
    """Return where the mapping file of a table stands, which says which column is which."""
    return table.with_name(f"{table.stem}.columns.toml")
