"""Tell of a path, before it is read, why no recording can be there, and which ones are near it."""

from __future__ import annotations

from pathlib import Path

from benchtool.core.errors import FileFormatError, InputError
from benchtool.data.run.entry import kind_of
from benchtool.data.run.read import is_run

TOLD = 6
"""As many recordings of a folder are named; a choice."""

OTHERS = {
    ".toml": "a TOML file (a model goes behind --model)",
    ".json": "a JSON file",
    ".html": "a page",
    ".svg": "a picture",
    ".png": "a picture",
    ".txt": "a text file",
}
"""What files that stand beside recordings are by their names."""

TAKEN = "a recording is a CSV, a Parquet file with its JSON, or a run folder"


def unreadable(path: str) -> InputError | None:
    """Return why a path can be no recording; None where one may be."""
    file = Path(path)
    if not file.exists():
        return FileFormatError(path, "there is no such run or file; check the path")
    if file.is_dir():
        return None if is_run(file) else FileFormatError(path, _of_folder(file))
    if file.suffix.lower() in OTHERS:
        return FileFormatError(path, f"this is {OTHERS[file.suffix.lower()]}; {TAKEN}")
    return None


def recordings_in(folder: Path) -> list[Path]:
    """Return the recordings of a folder, else those of the folders in it.

    Tables that nothing says more of count where there is nothing better.
    """
    for pattern in ("*", "*/*"):
        found = [item for item in sorted(folder.glob(pattern)) if not item.name.startswith(".")]
        kinds = {item: kind_of(item) for item in found}
        for wanted in (("recording", "sweep"), ("table",)):
            listed = [
                item
                for item, kind in kinds.items()
                if kind in wanted and (kind != "sweep" or is_run(item))
            ]
            if listed:
                return listed
    return []


def _of_folder(folder: Path) -> str:
    found = recordings_in(folder)
    if not found:
        return f"this folder is no run, and no recording is in it; {TAKEN}"
    named = ", ".join(str(item) for item in found[:TOLD])
    more = f" and {len(found) - TOLD} more" if len(found) > TOLD else ""
    if len(found) == 1:
        return f"this folder is no run; name the recording in it: {named}"
    return f"this folder is no run; name one or more of the recordings in it: {named}{more}"
