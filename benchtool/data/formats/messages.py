"""Messages of a flight log of any format, and their merge into a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.channel import Channel, unit_from_name
from benchtool.core.recording import Recording
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.data.repairs.import_result import Finding

Times = NDArray[np.int64]

Scales = Mapping[str, tuple[str, float]]  # by channel: field and factor
LOOKS_DOWN = 25  # MAV_SENSOR_ROTATION_PITCH_270, in logs of ArduPilot and PX4

RAD = np.pi / 180.0


@dataclass(frozen=True, slots=True, eq=False)
class Stream:
    """Channels of one kind of message.

    Attributes:
        source: the message's name in the log, for display.
        time_us: (m,) on the log's clock.
        columns: (m,) values in the channel's unit, by channel name.
        fields: the message's field by channel name, for display.
    """

    source: str
    time_us: Times
    columns: dict[str, Array]
    fields: dict[str, str]

    def blank(
        self, channel: str, is_bad: NDArray[np.bool_], reason: str, findings: list[Finding]
    ) -> None:
        """Blank readings (m,) that the sensor reports as bad; `reason` completes "that ..."."""
        self.columns[channel][is_bad] = np.nan
        if count := int(np.count_nonzero(is_bad)):
            what = "distance" if channel == "distance_m" else "rpm"
            text = f"{pluralize(count, 'reading')} that {reason}, blanked"
            findings.append(Finding("repaired", what, text, channel, count))


@dataclass(frozen=True, slots=True, eq=False)
class Messages:
    """Messages of one kind, as columns.

    Attributes:
        source: the kind's name in the log, for display.
        time_us: (m,) on the log's clock; None if the messages have no time.
        fields: (m,) each, by name; the elements of an array are "name[0]" and so on.
        divisors: divisor of a field's numbers by name; default 1.
    """

    source: str
    time_us: Times | None
    fields: Mapping[str, NDArray[Any]]
    divisors: Mapping[str, float] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(next(iter(self.fields.values()), ()))

    def has(self, *names: str) -> bool:
        """Return whether there are messages with these fields."""
        return len(self) > 0 and all(name in self.fields for name in names)

    def numbers(self, name: str) -> Array:
        """Return a copy of one field as numbers (m,); nan for text that is not a number."""
        values = self.fields[name]
        if values.dtype.kind in "SV":
            return np.array([_number(cell) for cell in values.tolist()], float)
        divisor = self.divisors.get(name, 1.0)
        numbers: Array = values.astype(float)
        return numbers / divisor if divisor != 1.0 else numbers

    def texts(self, name: str) -> list[str]:
        """Return one field as text, (m,)."""
        cells = self.fields[name].tolist()
        return [cell.split(b"\0")[0].decode("utf-8", "replace") for cell in cells]

    def where(self, rows: NDArray[np.bool_]) -> Messages:
        """Return the chosen messages, rows (m,)."""
        times = None if self.time_us is None else self.time_us[rows]
        chosen = {name: values[rows] for name, values in self.fields.items()}
        return Messages(self.source, times, chosen, self.divisors)

    def stream(self, scales: Scales) -> list[Stream]:
        """Return a stream of the channels with a field in the messages; empty without any."""
        columns, fields = {}, {}
        for channel, (name, scale) in scales.items():
            if self.has(name):
                numbers = self.numbers(name)
                columns[channel] = numbers if scale == 1.0 else numbers * scale
                fields[channel] = name
        if self.time_us is None or not columns:
            return []
        return [Stream(self.source, self.time_us, columns, fields)]

    def attitude(self, name: str, *, suffix: str = "") -> list[Stream]:
        """Return the angles, nose down positive, from a field of quaternions, body to earth."""
        parts = [f"{name}[{i}]" for i in range(4)]
        if self.time_us is None or not self.has(*parts):
            return []
        roll, pitch, yaw = euler_angles(*map(self.numbers, parts))
        angles = {"theta": -pitch, "roll": roll, "yaw": yaw}
        columns = {f"{angle}{suffix}_rad": values for angle, values in angles.items()}
        return [Stream(self.source, self.time_us, columns, dict.fromkeys(columns, name))]

    def select_downward(self, name: str, findings: list[Finding]) -> Messages:
        """Return readings of sensors that look down; if there are none, with a finding."""
        down = self.numbers(name) == LOOKS_DOWN
        if not down.any():
            text = f"{pluralize(down.size, 'reading')} of sensors that do not look down"
            findings.append(Finding("left out", "distance", text, "distance_m", down.size))
        return self.where(down)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MessageLog:
    """Messages of a log by kind, with counts.

    Attributes:
        kinds: messages by the name of their kind.
        total: complete messages in the log, of any kind.
        broken: corrupt or incomplete messages.
        findings: of the parser; the reader of the messages appends to it.
    """

    kinds: Mapping[str, Messages]
    total: int
    broken: int
    findings: list[Finding]

    def __getitem__(self, kind: str) -> Messages:
        return self.kinds.get(kind, Messages(kind, None, {}))


def _number(cell: Any) -> float:
    try:
        return float(cell)
    except (TypeError, ValueError):
        return float("nan")


def euler_angles(w: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array, Array]:
    """Return roll, pitch (nose up) and yaw of quaternions (n,) from body to earth, z down: rad.

    A quaternion of zeros, as in some logs before the first estimate, results in nan.
    """
    size = np.sqrt(w * w + x * x + y * y + z * z)
    is_zero = ~(size > 0.5)
    size = np.where(is_zero, 1.0, size)
    w, x, y, z = w / size, x / size, y / size, z / size
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return tuple(np.where(is_zero, np.nan, angle) for angle in (roll, pitch, yaw))  # type: ignore[return-value]


def merge_streams(streams: Sequence[Stream]) -> tuple[Recording, int]:
    """Return the streams as one recording, sorted by time, and the number of messages not in order.

    time_s begins at the first message; device_time_us is the log's clock. A channel is nan
    in the rows of other messages. Messages of one kind with the same time get a row each.
    """
    times = np.concatenate([stream.time_us for stream in streams])
    ranks = np.concatenate([_rank_equal_times(stream.time_us) for stream in streams])
    order = np.lexsort((ranks, times))
    ordered, rank = times[order], ranks[order]
    is_new = np.concatenate([[True], (np.diff(ordered) != 0) | (np.diff(rank) != 0)])
    row = np.empty(times.size, np.intp)
    row[order] = np.cumsum(is_new) - 1
    at_us = ordered[is_new]
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
        Channel(name, unit_from_name(name)) for name in ("time_s", "device_time_us", *names)
    )
    disordered = sum(int(np.count_nonzero(np.diff(stream.time_us) < 0)) for stream in streams)
    return Recording(channels, values), disordered


def _rank_equal_times(time_us: Times) -> NDArray[np.intp]:
    """Return the number of earlier messages of the same time, for each message (m,)."""
    order = np.argsort(time_us, kind="stable")
    ordered = time_us[order]
    starts = np.concatenate([[True], np.diff(ordered) != 0])[: ordered.size]
    index = np.arange(ordered.size)
    rank = np.empty(ordered.size, np.intp)
    rank[order] = index - np.maximum.accumulate(np.where(starts, index, 0))
    return rank
