"""Steady levels of a test stand log: means of every channel at constant throttle."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchtool.core.channel import Channel, error_channel_name, unit_from_name
from benchtool.core.errors import FileFormatError
from benchtool.core.recording import Recording
from benchtool.core.user_file import open_file
from benchtool.data.csv_header import has_columns
from benchtool.data.derived import (
    MeasurementContext,
    build_recording_context,
    measurement_context,
)
from benchtool.data.formats.formats import HEAD_BYTES, import_file, is_stand_table
from benchtool.data.run.recording_file import metadata_path, read_recording, read_recording_facts

AVERAGED_SHARE = 0.5  # last part of a level, after it has settled, that is averaged; assumed
BIN_S = 0.5  # span of a mean in a fast log without steps of throttle; assumed

AVERAGED = ("thrust_N", "torque_Nm", "voltage_V", "current_A", "power_W", "mechanical_power_W")
"""Channels whose means have a standard error, in addition to the speeds."""


def read_levels(path: Path) -> tuple[Recording, MeasurementContext]:
    """Return the levels of a recording or of a test stand's table, which is imported."""
    if metadata_path(path).is_file():
        facts = read_recording_facts(path)
        context = build_recording_context(facts, str(metadata_path(path)))
        return split_levels(read_recording(path)), context
    if not path.exists():
        raise FileFormatError(str(path), "there is no such file or run folder; check the path")
    if not path.is_file() or not (is_stand_table(path) or _has_channels(path)):
        raise FileFormatError(
            str(path),
            "it is not a run folder, recording or log of a known test stand; make a recording with "
            "benchtool import, which accepts a column map (--columns) for any table",
        )
    result = import_file(path)
    return split_levels(result.recording), measurement_context(result.propeller)


def _has_channels(path: Path) -> bool:
    """Return whether a table names the channels of a thrust curve."""
    with open_file(path) as file:
        return has_columns("pwm1_us", "thrust_N")(file.read(HEAD_BYTES))


def split_levels(recording: Recording) -> Recording:
    """Return a row for each level of throttle in a log, with standard errors of its means.

    A log with one row per level, as from a step test, is returned unchanged. Each channel is
    averaged over its finite samples. Errors assume independent samples; a level of one sample has
    no error.
    """
    level = _number_levels(recording)
    if level is None:
        return recording
    names = recording.names
    errors = {
        error_channel_name(name): index
        for index, name in enumerate(names)
        if (name in AVERAGED or name.startswith("rpm")) and error_channel_name(name) not in names
    }
    rows = []
    for number in np.unique(level[level >= 0]):
        part = np.ma.masked_invalid(recording.values[level == number])
        variance = part.var(axis=0, ddof=1).filled(np.nan) / np.maximum(part.count(axis=0), 1)
        error = np.sqrt(variance)[list(errors.values())]
        rows.append([*part.mean(axis=0).filled(np.nan), *error])
    channels = (*recording.channels, *(Channel(name, unit_from_name(name)) for name in errors))
    values = np.array(rows, float).reshape(len(rows), len(channels))
    return Recording(channels, values, recording.provenance, recording.simulated)


def _number_levels(recording: Recording) -> NDArray[np.intp] | None:
    """Return the level of each row (n,), -1 if excluded; None if every row is a level."""
    n, step_s = len(recording), BIN_S
    if "time_s" in recording and n > 2:
        time_s = recording.to_si("time_s")
        step_s = float(np.median(np.diff(time_s))) if np.isfinite(time_s).all() else BIN_S
    if "pwm1_us" in recording and np.isfinite(pulse := recording.column("pwm1_us")).mean() > 0.9:
        segment = np.concatenate([[0], np.cumsum(pulse[1:] != pulse[:-1])])
        length = np.bincount(segment)[segment]
        if (mean := n / (segment[-1] + 1)) >= 3.0 and mean * step_s >= BIN_S:
            position = np.arange(n) - np.searchsorted(segment, segment)
            return np.where(position >= np.floor(AVERAGED_SHARE * length), segment, -1).astype(
                np.intp
            )
    if step_s < 0.2 * BIN_S:
        return np.asarray(np.floor((time_s - time_s.min()) / BIN_S), np.intp)
    return None
