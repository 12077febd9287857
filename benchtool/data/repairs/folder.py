"""Say which files of a folder can be imported, for somebody who named the folder."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path

from benchtool.core.errors import FileFormatError
from benchtool.core.user_file import open_file

HEAD_BYTES = 1 << 16
"""A file's beginning tells its format: a header and some rows."""

LISTED = 8
"""So many files are named; a sentence holds no more. A choice."""


def told_of_folder(folder: Path, can_import: Callable[[bytes, str], bool]) -> str:
    """Return what to do with a folder in words, with the command where files can be imported.

    Args:
        folder: that was named in a file's place.
        can_import: tells it of a file's first bytes and its path.
    """
    found = [
        path
        for path in sorted(folder.iterdir())
        if path.is_file() and can_import(_head_of(path), str(path))
    ]
    if not found:
        inner = [f"{path}/" for path in sorted(folder.iterdir()) if path.is_dir()][:LISTED]
        instead = f"look into {', '.join(inner)}" if inner else "name the file of a log or a table"
        return f"this is a folder, and none of its files is known; {instead}"
    names = [shlex.quote(str(path)) for path in found[:LISTED]]
    rest = f" (and {len(found) - LISTED} more)" if len(found) > LISTED else ""
    return f"this is a folder; name files in it: benchtool import {' '.join(names)}{rest}"


def _head_of(path: Path) -> bytes:
    try:
        with open_file(path) as file:
            head = file.read(HEAD_BYTES)
    except (OSError, FileFormatError):
        return b""
    if len(head) < HEAD_BYTES:
        return head
    return head[: head.rfind(b"\n") + 1] or head
