"""Columns of benchtool's files: names, units and enumerated labels."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from benchtool.core.channel import Channel, is_known_channel, unit_from_name
from benchtool.core.errors import FileFormatError, InputError, UnknownChoice
from benchtool.core.recording import Recording
from benchtool.core.units import Array
from benchtool.core.user_file import MAX_NUMBER
from benchtool.data.column_map import IDENTITY, find_conversion, parse_header_cell

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


def columns_to_frame(
    columns: Mapping[str, Array], units: Mapping[str, str], index: Any = None
) -> pd.DataFrame:
    """Return columns as a data frame, units in `attrs`; default index: row numbers."""
    import pandas as pd

    table = pd.DataFrame(dict(columns), index=index)
    table.attrs["units"] = dict(units)
    return table


def concatenate_frames(recordings: Mapping[str, Recording]) -> pd.DataFrame:
    """Return the concatenated recordings as a data frame, with their names in column `run`."""
    import pandas as pd

    parts = {name: to_frame(recording) for name, recording in recordings.items()}
    table = pd.concat(parts, names=["run"]).reset_index(level=0).reset_index(drop=True)
    units = {name: unit for part in parts.values() for name, unit in part.attrs["units"].items()}
    table.attrs["units"] = units
    return table


def table_to_csv(table: pd.DataFrame | Mapping[str, object]) -> str:
    """Return a data frame or a mapping of arrays as CSV text, units of `attrs` in the header.

    Raises InputError for columns of different lengths, or a unit that contradicts a channel's name.
    """
    import pandas as pd

    if isinstance(table, Mapping):
        try:
            table = pd.DataFrame({str(name): column for name, column in table.items()})
        except ValueError as error:
            raise InputError(f"columns are not arrays of one length ({error})") from error
    elif any(name is not None for name in table.index.names):
        table = table.reset_index()
    units = table.attrs.get("units") or {}
    return table.to_csv(index=False, header=[_header_cell(name, units) for name in table])


def _header_cell(name: object, units: Mapping[object, str]) -> str:
    """Return the name of a column, with its unit in brackets unless the name contains it."""
    text, unit = str(name), units.get(name) or "1"
    if unit in ("1", unit_from_name(text)) or parse_header_cell(text).unit is not None:
        return text
    if not is_known_channel(text):
        return f"{text} [{unit}]"
    if find_conversion(unit, unit_from_name(text)) != IDENTITY:
        raise InputError(
            f"attrs['units'] contain {unit!r} for {text}, which is in {unit_from_name(text)}; "
            f"convert the column, or rename it"
        )
    return text


def to_frame(recording: Recording) -> pd.DataFrame:
    """Return a recording as a data frame, labels instead of codes, units in `attrs`."""
    import pandas as pd

    table = pd.DataFrame(recording.values, columns=list(recording.names))
    for name in filter(is_whole, recording.names):
        values = recording.column(name)
        if np.isfinite(values).all() and (values == np.floor(values)).all():
            table[name] = values.astype(np.int64)
    for name, labels in WORDS.items():
        if name in table:
            codes = table[name].to_numpy().astype(int)
            table[name] = pd.Categorical.from_codes(codes, categories=pd.Index(labels))
    table.attrs["units"] = {channel.name: channel.unit for channel in recording.channels}
    table.attrs["provenance"] = dict(recording.provenance)
    return table
