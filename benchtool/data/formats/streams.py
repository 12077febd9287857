"""Lay messages of different rates into one table: a row for each time, nothing repeated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchtool.core.channel import Channel, unit_told_by
from benchtool.core.recording import Recording

Array = NDArray[np.float64]
Times = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Stream:
    """Hold the messages of one kind.

    Attributes:
        source: the message's name in the log, for people.
        time_us: (m,) on the log's clock.
        columns: channel name and (m,) values in its unit.
        fields: channel name and the message's field, for people.
    """

    source: str
    time_us: Times
    columns: dict[str, Array]
    fields: dict[str, str]


def merged(streams: Sequence[Stream]) -> tuple[Recording, int]:
    """Return the streams as one recording, by time, and how many messages stood out of order.

    time_s counts from the first message; device_time_us is the log's own clock. A channel is nan
    in the rows of other messages. Messages of one kind with the same time get a row each.
    """
    times = np.concatenate([stream.time_us for stream in streams])
    places = np.concatenate([_place_among_equals(stream.time_us) for stream in streams])
    order = np.lexsort((places, times))
    ordered, place = times[order], places[order]
    fresh = np.concatenate([[True], (np.diff(ordered) != 0) | (np.diff(place) != 0)])
    row = np.empty(times.size, np.intp)
    row[order] = np.cumsum(fresh) - 1
    at_us = ordered[fresh]
    names = [name for stream in streams for name in stream.columns]
    values = np.full((at_us.size, 2 + len(names)), np.nan)
    values[:, 0] = 1e-6 * (at_us - at_us[0])
    values[:, 1] = at_us
    begin, column = 0, 2
    for stream in streams:
        rows = row[begin : begin + stream.time_us.size]
        begin += stream.time_us.size
        for channel_values in stream.columns.values():
            values[rows, column] = channel_values
            column += 1
    channels = tuple(
        Channel(name, unit_told_by(name)) for name in ("time_s", "device_time_us", *names)
    )
    disordered = sum(int(np.count_nonzero(np.diff(stream.time_us) < 0)) for stream in streams)
    return Recording(channels, values), disordered


def _place_among_equals(time_us: Times) -> NDArray[np.intp]:
    """Return how many earlier messages of the same time there are, for each message (m,)."""
    order = np.argsort(time_us, kind="stable")
    ordered = time_us[order]
    at = np.arange(ordered.size)
    starts = np.concatenate([[True], np.diff(ordered) != 0]) if ordered.size else at.astype(bool)
    place = np.empty(ordered.size, np.intp)
    place[order] = at - np.maximum.accumulate(np.where(starts, at, 0))
    return place
