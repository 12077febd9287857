"""Tags and notes of a run, a fit or an explanation, in labels.json.

They are not in metadata.json because the program that measures a run rewrites that file from
memory and would discard them.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from benchtool.core.errors import FileFormatError, InputError, check_name
from benchtool.core.toml_text import build_dataclass
from benchtool.data.atomic import read_json, replace_json

LABELS_FILE = "labels.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class Labels:
    """Tags and notes of a run."""

    tags: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def read_labels(folder: Path) -> Labels:
    """Return the labels of a folder; empty if it has none."""
    path = folder / LABELS_FILE
    if not os.path.lexists(path):
        return Labels()
    return build_dataclass(Labels, read_json(path, follow=False), str(path))


def check_labels(
    folders: Iterable[Path], add: Iterable[str] = (), remove: Iterable[str] = ()
) -> None:
    """Check the arguments of `update_labels` for several folders before the first is changed."""
    remove = tuple(remove)
    for tag in add:
        check_name("tag", tag, max_length=60)
    for folder in folders:
        if not folder.is_dir():
            raise FileFormatError(
                str(folder), "there is no such folder; name runs or fits, and tags with --add"
            )
        _remaining_tags(folder, read_labels(folder), remove)


def _remaining_tags(folder: Path, labels: Labels, remove: tuple[str, ...]) -> Iterator[str]:
    if missing := [tag for tag in remove if tag not in labels.tags]:
        tags = ", ".join(labels.tags) or "none"
        raise InputError(f"{folder} has no tag {missing[0]!r} to remove (it has: {tags})")
    return (tag for tag in labels.tags if tag not in remove)


def update_labels(
    folder: Path, add: Iterable[str] = (), remove: Iterable[str] = (), note: str = ""
) -> Labels:
    """Add and remove tags, add a note, and return the new labels.

    A lock serialises programs that label the same folder (not on Windows).
    """
    add, remove = tuple(add), tuple(remove)
    check_labels((folder,), add)
    with _locked(folder):
        labels = read_labels(folder)
        tags = tuple(dict.fromkeys((*_remaining_tags(folder, labels, remove), *add)))
        new_labels = Labels(tags=tags, notes=(*labels.notes, *([note] if note else ())))
        if new_labels != labels:
            replace_json(folder / LABELS_FILE, asdict(new_labels))
    return new_labels


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    if sys.platform == "win32":
        yield
        return
    import fcntl

    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)
