"""Atomic writes of files and folders, and file hashes."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from math import isfinite
from pathlib import Path
from typing import Any, BinaryIO

from benchtool.core.errors import FileFormatError, WouldOverwrite
from benchtool.core.toml_text import parse_json
from benchtool.core.user_file import MAX_METADATA_BYTES, open_file, read_text


@contextmanager
def atomic_writer(path: Path, temporary: Path) -> Iterator[BinaryIO]:
    """Yield a new file `temporary`; at the end sync it to disk and rename it to `path`.

    On an error the temporary file is removed and `path` is unchanged.
    """
    try:
        temporary.unlink(missing_ok=True)
        with open(temporary, "xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        with suppress(OSError):
            temporary.unlink()
        raise
    sync_folder(path.parent)


def replace_bytes(path: Path, data: bytes) -> None:
    """Replace a file's bytes atomically, synced to disk before the rename."""
    with atomic_writer(path, path.with_name(f".{path.name}.{os.getpid()}.new")) as file:
        file.write(data)


def replace_text(path: Path, text: str) -> None:
    """Replace a file's text atomically, synced to disk before the rename."""
    replace_bytes(path, text.encode())


def replace_json(path: Path, data: Mapping[str, Any]) -> None:
    """Replace a JSON file atomically; nan and infinity raise ValueError before the write."""
    replace_text(path, json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def json_ready(value: Any) -> Any:
    """Return the value with nan and infinity as None and NumPy numbers as Python numbers."""
    import numpy as np

    if isinstance(value, Mapping):
        return {str(key): json_ready(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_ready(item) for item in value]
    if isinstance(value, np.generic):
        return json_ready(value.item())
    if isinstance(value, float) and not isfinite(value):
        return None
    return value


def read_json(path: Path, *, follow: bool = True) -> dict[str, Any]:
    """Return the JSON object in a file; an error has the position of the fault."""
    data = parse_json(read_text(path, MAX_METADATA_BYTES, follow=follow), str(path))
    if not isinstance(data, dict):
        raise FileFormatError(str(path), "a JSON object is needed; restore the file from a copy")
    return data


def make_folder(folder: Path) -> None:
    """Create a folder and missing parents, each synced to disk against power cuts."""
    missing = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for created in reversed(missing):
        sync_folder(created.parent)


def sync_folder(folder: Path) -> None:
    """Sync a folder's entries to disk where the system supports it (not on Windows)."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def partial_folder(out: Path) -> Path:
    """Return the hidden name of a folder while it is written; lists of runs omit it."""
    return out.with_name(f".{out.name}.part")


@contextmanager
def write_atomically(out: Path) -> Iterator[Path]:
    """Yield the hidden name of a folder, not yet created; renamed to `out` after the block."""
    part = partial_folder(out)
    shutil.rmtree(part, ignore_errors=True)
    yield part
    complete_folder(out, out)


def complete_folder(started_for: Path, out: Path) -> None:
    """Rename the complete folder from its hidden name to `out`."""
    if out.exists():
        raise WouldOverwrite(str(out))
    partial_folder(started_for).rename(out)


DATA_FILES: tuple[str, ...] = ("points.csv", "samples.csv")  # make a run's hash


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


def write_if_new(path: Path, text: str) -> tuple[Path, bool]:
    """Return a file with this text, and whether it is new; another text of the name stays.

    The file is `path`, or `path` with a number before its suffix.
    """
    file, number = path, 1
    while file.exists():
        if file.read_text(encoding="utf-8", errors="replace") == text:
            return file, False
        number += 1
        file = path.with_name(f"{path.stem}-{number}{path.suffix}")
    file.write_text(text, encoding="utf-8")
    return file, True
