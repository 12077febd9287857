"""Hash data, so that a result can name exactly what it was computed from."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from benchtool.core.errors import FileFormatError
from benchtool.core.user_file import open_file

DATA_FILES: tuple[str, ...] = ("points.csv", "samples.csv")
"""Files of a run folder whose bytes make its hash."""


def file_hash(path: Path, *, follow: bool = True) -> str:
    """Return the SHA-256 of a file's bytes, in hex."""
    with open_file(path, follow=follow) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def data_hash(path: str | Path) -> str:
    """Return the SHA-256 of a data file, or of a run folder's points and samples, in hex."""
    path = Path(path)
    if os.path.lexists(path) and not os.path.isdir(path):
        return file_hash(path)
    present = [path / name for name in DATA_FILES if (path / name).is_file()]
    if not present:
        raise FileFormatError(str(path), "neither a file nor a run folder; check the path")
    total = hashlib.sha256()
    for file in present:
        total.update(f"{file.name} {file_hash(file, follow=False)}\n".encode())
    return total.hexdigest()
