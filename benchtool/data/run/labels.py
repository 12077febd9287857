"""labels.json: the tags and notes that people give a run, a fit or an explanation.

They stand in a file of their own: the program that measures a run replaces its metadata.json from
memory, and would take a label away that was written there meanwhile.
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
    """Hold what people say of a run."""

    tags: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def read_labels(folder: Path) -> Labels:
    """Return the labels of what is at a path; none where nobody gave any."""
    path = folder / LABELS_FILE
    if not os.path.lexists(path):
        return Labels()
    return build_dataclass(Labels, read_json(path, follow=False), str(path))


def check_labels(
    folders: Iterable[Path], add: Iterable[str] = (), remove: Iterable[str] = ()
) -> None:
    """Refuse what `label` would refuse of any of some folders, before the first is changed."""
    remove = tuple(remove)
    for tag in add:
        check_name("tag", tag, max_length=60)
    for folder in folders:
        if not folder.is_dir():
            raise FileFormatError(
                str(folder), "there is no such folder; name runs or fits, and tags with --add"
            )
        _left(folder, read_labels(folder), remove)


def _left(folder: Path, labels: Labels, remove: tuple[str, ...]) -> Iterator[str]:
    """Return the tags that are left."""
    if missing := [tag for tag in remove if tag not in labels.tags]:
        shown = ", ".join(labels.tags) or "none"
        raise InputError(f"{folder} has no tag {missing[0]!r} to remove (it has: {shown})")
    return (tag for tag in labels.tags if tag not in remove)


def label(
    folder: Path, add: Iterable[str] = (), remove: Iterable[str] = (), note: str = ""
) -> Labels:
    """Add and remove tags, add a note, and return what there is then.

    Two programs that label one folder at once wait for each other (not on Windows).

    Raises:
        InputError: a word that is no tag, or a tag to be removed that is not there.
        FileFormatError: there is no such folder.
        OSError: the folder cannot be written.
    """
    add, remove = tuple(add), tuple(remove)
    check_labels((folder,), add)
    with _locked(folder):
        labels = read_labels(folder)
        left = _left(folder, labels, remove)
        new = Labels(
            tags=tuple(dict.fromkeys((*left, *add))),
            notes=(*labels.notes, *([note] if note else ())),
        )
        if new != labels:
            replace_json(folder / LABELS_FILE, asdict(new))
    return new


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
