"""Columns of benchtool's files: names, units and enumerated labels."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from benchtool.core.channel import Channel, unit_from_name
from benchtool.core.errors import FileFormatError, UnknownChoice
from benchtool.core.recording import Recording
from benchtool.core.user_file import MAX_NUMBER

if TYPE_CHECKING:
    import pandas as pd

VALID_KINDS: tuple[str, ...] = ("measure", "reference", "anchor", "tare")  # of points

KINDS: tuple[str, ...] = (*VALID_KINDS, "failed")
"""Kinds of points; in a `Recording` the channel `kind` holds the position in this tuple.

measure: a setting of the plan; reference: the same throttle with the plate parked, taken as out of
ground effect; anchor: one setting repeated to detect drift; tare: the residual after a tare;
failed: a point with too few samples, ignored by readers and repeated by a resumed run.
"""

PHASES: tuple[str, ...] = ("tare", "move", "rest", "ramp", "settle", "sample", "end", "interrupted")
"""Phases of samples; in a `Recording` the channel `phase` holds the position in this tuple.

Only `sample` rows make points. Rows of an incomplete point are `interrupted` in a resumed run.
"""

WORDS: dict[str, tuple[str, ...]] = {"kind": KINDS, "phase": PHASES}  # columns of words

SAMPLE_START: tuple[str, ...] = ("time_s", "device_time_us", "point", "phase")
"""First columns of samples.csv; the device's channels follow in device order."""

_SPEED = re.compile(r"rpm\d+|pwm\d+_us")


def speed_columns(names: Iterable[str], family: str = "") -> list[str]:
    """Return the columns of rotor speeds and pulse widths, or those that begin with `family`."""
    return [name for name in names if _SPEED.fullmatch(name) and name.startswith(family)]


REJECTED = "_rejected"  # suffix of columns with the number of samples excluded from a mean

_WHOLE = {"point", "setting", "repeat", "n_samples", "n_repeats", "settled", "suspect", "part"}


def is_whole(name: str) -> bool:
    """Return whether a column of benchtool's files contains whole numbers from 0."""
    return name in _WHOLE or name.endswith(REJECTED)


MAX_RUN_DURATION_S = 1e8  # duration of a run: 3 years; assumed
MAX_DEVICE_TIME_US = 1e15  # uptime of a device: 30 years; assumed

_PIECE = 1 << 16


def check_numbers(recording: Recording, where: str) -> None:
    """Raise FileFormatError for numbers that are impossible in benchtool's files.

    These are numbers beyond `MAX_NUMBER`, times out of range, and counts that are not whole.
    """
    for name in recording.names:
        column = recording.column(name)
        for start in range(0, len(column), _PIECE):  # a few bytes a row, not three copies
            values = column[start : start + _PIECE]
            wrong = np.abs(values) > MAX_NUMBER
            if is_whole(name):
                wrong |= ~((values >= 0.0) & (values < 2.0**53) & (values == np.floor(values)))
            elif name == "time_s":
                wrong |= ~(np.abs(values) <= MAX_RUN_DURATION_S)
            elif name == "device_time_us":
                wrong |= ~(np.abs(values) <= MAX_DEVICE_TIME_US)
            if wrong.any():
                row = int(np.argmax(wrong))
                raise FileFormatError(
                    f"{where}, row {start + row + 1}",
                    f"{name} is {values[row]:g}, out of range; restore the file from a copy",
                )


def find_channel(name: str) -> Channel:
    """Return the channel of a column of benchtool's files."""
    if name in WORDS:
        codes = ", ".join(f"{index} {word}" for index, word in enumerate(WORDS[name]))
        return Channel(name, "1", codes)
    return Channel(name, unit_from_name(name))


def word_to_code(column: str, word: str) -> float:
    """Return the code of a label in a `Recording`."""
    try:
        return float(WORDS[column].index(word))
    except ValueError:
        raise UnknownChoice(column, word, WORDS[column]) from None


def code_to_word(column: str, code: float) -> str:
    """Return the label of a code in a `Recording`."""
    return WORDS[column][int(code)]


def rows_to_frame(rows: Sequence[Mapping[str, object]]) -> pd.DataFrame:
    """Return rows (value by column name) as a data frame, units in `attrs`."""
    import pandas as pd

    table = pd.DataFrame.from_records(list(rows))
    units = {str(name): unit_from_name(str(name)) for name in table}
    table.attrs["units"] = {name: unit for name, unit in units.items() if unit}
    return table


def concatenate_frames(recordings: Mapping[str, Recording]) -> pd.DataFrame:
    """Return the concatenated recordings as a data frame, with their names in column `run`."""
    import pandas as pd

    parts = {name: to_frame(recording) for name, recording in recordings.items()}
    table = pd.concat(parts, names=["run"]).reset_index(level=0).reset_index(drop=True)
    units = {name: unit for part in parts.values() for name, unit in part.attrs["units"].items()}
    table.attrs["units"] = units
    return table


def to_frame(recording: Recording) -> pd.DataFrame:
    """Return a recording as a data frame, labels instead of codes, units in `attrs`."""
    import pandas as pd

    table = pd.DataFrame(recording.values, columns=list(recording.names))
    for name, labels in WORDS.items():
        if name in table:
            codes = table[name].to_numpy().astype(int)
            table[name] = pd.Categorical.from_codes(codes, categories=pd.Index(labels))
    table.attrs["units"] = {channel.name: channel.unit for channel in recording.channels}
    table.attrs["provenance"] = dict(recording.provenance)
    return table
