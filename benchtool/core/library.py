"""Lookup of library files by name or path."""

from __future__ import annotations

import os
from pathlib import Path

from benchtool.core.errors import FileFormatError, UnknownChoice
from benchtool.core.user_file import display_path, read_text, user_folder

LIBRARY = Path(__file__).resolve().parents[1] / "library"  # folder of the bundled files


def user_library_folder() -> Path:
    """Return the folder of user-defined rigs, propellers and so on, with a subfolder per kind.

    BENCHTOOL_LIBRARY if set, else below the user's data folder. It need not exist.
    """
    if folder := os.environ.get("BENCHTOOL_LIBRARY"):
        return Path(folder)
    return user_folder("XDG_DATA_HOME", ".local/share") / "library"


def user_names(folder: str) -> tuple[str, ...]:
    """Return the names of user-defined files of one kind."""
    return tuple(sorted(path.stem for path in (user_library_folder() / folder).glob("*.toml")))


def list_names(folder: str) -> tuple[str, ...]:
    """Return the names in `benchtool/library/<folder>`."""
    return tuple(sorted(path.stem for path in (LIBRARY / folder).glob("*.toml")))


def read_library_file(kind: str, folder: str, name_or_path: str | Path) -> tuple[str, str]:
    """Return (text, where) for a library name, a user-defined name, or a path ending in .toml.

    Raises:
        UnknownChoice: unknown name.
        FileFormatError: unreadable path, or a user-defined file with the name of a bundled one.
    """
    name, user_defined = str(name_or_path), user_names(folder)
    if name in user_defined:
        user_path = user_library_folder() / folder / f"{name}.toml"
        if name in list_names(folder):
            raise FileFormatError(
                str(user_path), f"benchtool has a {kind} of this name; rename your file"
            )
        return read_text(user_path), str(user_path)
    if name in list_names(folder):
        where = f"{folder}/{name}.toml"
        return (LIBRARY / where).read_text(encoding="utf-8"), where
    path = Path(name)
    if path.suffix != ".toml" and not os.path.exists(path):
        raise UnknownChoice(
            f"{kind} or file",
            display_path(name),
            (*list_names(folder), *user_defined),
        )
    if os.path.isdir(path):
        inside = ", ".join(str(item) for item in sorted(path.glob("*.toml"))[:6])
        raise FileFormatError(
            name, f"this is a folder; name a TOML file{f' in it: {inside}' if inside else ''}"
        )
    return read_text(path), name
