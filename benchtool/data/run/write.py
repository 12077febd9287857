"""Write a recording as one of our own CSV files, in one step."""

from __future__ import annotations

from pathlib import Path

from benchtool.core.recording import Recording
from benchtool.data.atomic import replace_text
from benchtool.data.columns import WORDS
from benchtool.data.run.points import number_cell

_WHOLE = frozenset({"point", "setting", "repeat", "n_repeats", "n_samples", "settled"})


def write_table(path: Path, recording: Recording) -> None:
    """Write rows with words for their codes, whole numbers whole, and nan as an empty cell."""
    columns = [_cells(name, recording.column(name).tolist()) for name in recording.names]
    lines = [",".join(recording.names), *(",".join(row) for row in zip(*columns, strict=True))]
    replace_text(path, "\n".join(lines) + "\n")


def _cells(name: str, numbers: list[float]) -> list[str]:
    if name in WORDS:
        return [WORDS[name][int(number)] for number in numbers]
    if name in _WHOLE:
        return [f"{number:.0f}" for number in numbers]
    return [number_cell(number) for number in numbers]
