"""Paths that a page may name: inside of one folder, whatever was typed."""

from __future__ import annotations

from pathlib import Path

from benchtool.errors import InputError


def inside(folder: Path, name: str) -> Path:
    """Return the path of a name below a folder, links followed.

    Raises:
        InputError: it leads out of the folder, or is no name at all.
    """
    root = folder.resolve()
    try:
        path = (root / name).resolve()
    except (OSError, ValueError, RuntimeError):
        path = root
    if not name.strip() or path == root or not path.is_relative_to(root):
        raise InputError(
            f"{name!r} is not inside {folder}; the page reads and writes that folder only"
        )
    return path
