"""Find a file by the name under which benchtool ships it, or by its path."""

from __future__ import annotations

import os
from pathlib import Path

from benchtool.core.errors import FileFormatError, UnknownChoice
from benchtool.core.user_file import display_path, read_text, user_folder

LIBRARY = Path(__file__).resolve().parents[1] / "library"  # folder of the files that are shipped


def user_library_folder() -> Path:
    """Return the folder of this user's own rigs, propellers and so on, a folder for each kind.

    BENCHTOOL_LIBRARY where it is set, else that of the user's data. It need not exist.
    """
    if chosen := os.environ.get("BENCHTOOL_LIBRARY"):
        return Path(chosen)
    return user_folder("XDG_DATA_HOME", ".local/share") / "library"


def user_names(folder: str) -> tuple[str, ...]:
    """Return the names of the user's own files of one kind."""
    return tuple(sorted(path.stem for path in (user_library_folder() / folder).glob("*.toml")))


def list_names(folder: str) -> tuple[str, ...]:
    """Return the names shipped in `benchtool/library/<folder>`."""
    return tuple(sorted(path.stem for path in (LIBRARY / folder).glob("*.toml")))


def read_named(kind: str, folder: str, name_or_path: str | Path) -> tuple[str, str]:
    """Return (text, where) of a shipped name, of one's own, or of a path that ends in .toml.

    Raises:
        UnknownChoice: a name that is neither, with the known ones.
        FileFormatError: a path that cannot be read, or a file of one's own by a shipped name.
    """
    given, own = str(name_or_path), user_names(folder)
    if given in own:
        mine = user_library_folder() / folder / f"{given}.toml"
        if given in list_names(folder):
            raise FileFormatError(
                str(mine), f"a {kind} of this name is shipped with benchtool; rename yours"
            )
        return read_text(mine), str(mine)
    if given in list_names(folder):
        where = f"{folder}/{given}.toml"
        return (LIBRARY / where).read_text(encoding="utf-8"), where
    path = Path(given)
    if path.suffix != ".toml" and not os.path.exists(path):
        shown = display_path(given)
        raise UnknownChoice(
            f"{kind} (and no file of that name)", shown, (*list_names(folder), *own)
        )
    if os.path.isdir(path):
        inside = ", ".join(str(item) for item in sorted(path.glob("*.toml"))[:6])
        raise FileFormatError(
            given, f"this is a folder; name a TOML file{f' in it: {inside}' if inside else ''}"
        )
    return read_text(path), given
