"""Write small files so that a reader sees the old one or the new one, never a half."""

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
from benchtool.core.parsed_text import parse_json
from benchtool.core.user_file import MAX_METADATA_BYTES, open_file, read_text


@contextmanager
def atomic_writer(path: Path, temporary: Path) -> Iterator[BinaryIO]:
    """Give a new file `beside`; at the end force it to the disk and put it in place of `path`.

    After an error it is removed, and `path` stays as it was.
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
    """Write bytes in place of a file in one step, on the disk before it is in place."""
    with atomic_writer(path, path.with_name(f".{path.name}.{os.getpid()}.new")) as file:
        file.write(data)


def replace_text(path: Path, text: str) -> None:
    """Write text in place of a file in one step, on the disk before it is in place."""
    replace_bytes(path, text.encode())


def replace_json(path: Path, data: Mapping[str, Any]) -> None:
    """Write a JSON object in one step; numbers that JSON has not (nan) are refused early."""
    replace_text(path, json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def json_ready(value: Any) -> Any:
    """Return the value with nan and infinity as None and NumPy numbers as plain ones."""
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
    """Return the JSON object in a file, or say where it breaks."""
    data = parse_json(read_text(path, MAX_METADATA_BYTES, follow=follow), str(path))
    if not isinstance(data, dict):
        raise FileFormatError(str(path), "a JSON object is needed; restore the file from a copy")
    return data


def make_folder(folder: Path) -> None:
    """Make a folder, and those above it that are missing; a power cut takes away none of them."""
    missing = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for created in reversed(missing):
        sync_folder(created.parent)


def sync_folder(folder: Path) -> None:
    """Force a folder's entries to the disk where the system can (not on Windows)."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def partial_folder(out: Path) -> Path:
    """Return the hidden name under which a folder is written; a list of runs does not show it."""
    return out.with_name(f".{out.name}.part")


@contextmanager
def write_atomically(out: Path) -> Iterator[Path]:
    """Give the hidden name of a folder, empty; moved to `out` at the end of the block."""
    part = partial_folder(out)
    shutil.rmtree(part, ignore_errors=True)
    yield part
    complete_folder(out, out)


def complete_folder(started_for: Path, out: Path) -> None:
    """Move the complete folder from its hidden name to `out`.

    Raises:
        WouldOverwrite: something of that name exists.
    """
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
