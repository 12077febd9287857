"""Find a file by the name under which benchtool ships it, or by its path."""

from __future__ import annotations

import os
from pathlib import Path

from benchtool.core.errors import FileFormatError, UnknownChoice
from benchtool.core.user_file import read_text, shown_name

LIBRARY = Path(__file__).resolve().parents[1] / "library"
"""Folder of the files that are shipped."""


def packaged_names(folder: str) -> tuple[str, ...]:
    """Return the names shipped in `benchtool/library/<folder>`."""
    return tuple(sorted(path.stem for path in (LIBRARY / folder).glob("*.toml")))


def read_named(kind: str, folder: str, name_or_path: str | Path) -> tuple[str, str]:
    """Return (text, where) of a shipped name, or of a path that ends in .toml.

    Raises:
        UnknownChoice: a name that is not shipped, with the known ones.
        FileFormatError: a path that cannot be read.
    """
    given = str(name_or_path)
    if given in packaged_names(folder):
        where = f"{folder}/{given}.toml"
        return (LIBRARY / where).read_text(encoding="utf-8"), where
    path = Path(given)
    if path.suffix != ".toml" and not os.path.exists(path):
        shown = shown_name(given)
        raise UnknownChoice(f"{kind} (and no file of that name)", shown, packaged_names(folder))
    if os.path.isdir(path):
        inside = ", ".join(str(item) for item in sorted(path.glob("*.toml"))[:6])
        raise FileFormatError(
            given, f"this is a folder; name a TOML file{f' in it: {inside}' if inside else ''}"
        )
    return read_text(path), given
