"""Make a pitch recording of a flight log's streams, and say what the log lacks for one."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array import Array
from benchtool.core.channel import Channel, unit_told_by
from benchtool.core.counted import counted
from benchtool.core.errors import FileFormatError
from benchtool.core.recording import Recording
from benchtool.data.repairs.imported import Finding, Imported, Tally

Scales = Mapping[str, tuple[str, float]]
"""Channel name, and the field that it is read from with what multiplies it there."""

LOOKS_DOWN = 25
"""MAV_SENSOR_ROTATION_PITCH_270, which the logs of ArduPilot and PX4 count alike."""

LONG_GAP_S = 1.0
"""Attitude comes at 4 Hz and more in every log; a longer silence is a gap."""

LONGEST_LOG_US = 7 * 86400e6
"""No flight lasts a week: what is stamped farther off than that is a broken message."""

_NEEDS: tuple[tuple[str, str, str], ...] = (
    ("attitude", r"theta_rad", "no attitude stands in it, so it is no pitch recording"),
    ("rates", r"gyro_rad_s", "no rates stand in it; differences of the attitude are all there is"),
    ("reference", r"theta_ref_rad", "no wanted pitch stands in it"),
    ("outputs", r"pwm\d+_us|motor\d+_share", "no motor outputs stand in it"),
    ("rpm", r"rpm\d+", "no ESC or tachometer tells speeds; they can only be modelled from outputs"),
    ("distance", r"distance_m", "no distance sensor stands in it; --over says what it flew over"),
)
"""What a pitch recording is made of, the channels that hold it, and what its lack means."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Counts:
    """Count a log's messages.

    Attributes:
        total: whole messages in the log.
        broken: messages that could not be read whole.
    """

    total: int
    broken: int = 0


def flight_import(
    streams: Sequence[Stream],
    format_name: str,
    where: str,
    provenance: Mapping[str, str],
    findings: Sequence[Finding],
    counts: Counts,
) -> Imported:
    """Return a flight log as a pitch recording.

    Raises:
        FileFormatError: none of the messages that a recording is made of.
    """
    found = list(findings)
    streams, strange = _sane(streams, found)
    counts = replace(counts, total=counts.total - strange, broken=counts.broken + strange)
    if not streams:
        told = "; ".join(item.words for item in found if item.kind == "refused")
        raise FileFormatError(
            where,
            f"{counted(counts.total, 'message')} could be read, and none is attitude, rates, "
            f"outputs, rpm or distance{': ' + told if told else ''}; name a log of a flight",
        )
    recording, disordered = merged(streams)
    if disordered:
        words = f"{counted(disordered, 'message')} stamped before an earlier one; sorted by time"
        found.append(Finding("repaired", "time goes backwards", words, "time_s", disordered))
    if "theta_rad" in recording or "gyro_rad_s" in recording:
        words = "theta and gyro count nose down as positive, as benchtool does; logs count nose up"
        found.append(Finding("read as", "sign", words, "theta_rad"))
    for what, pattern, words in _NEEDS:
        if not any(re.fullmatch(pattern, name) for name in recording.names):
            found.append(Finding("lacks", what, words))
    found += _gaps(streams)
    retained = sum(stream.time_us.size for stream in streams)
    sources = {
        name: f"{stream.source}.{stream.fields[name]}"
        for stream in streams
        for name in stream.columns
    }
    return Imported(
        recording=replace(recording, provenance={**provenance, "rows": str(len(recording))}),
        format=format_name,
        findings=tuple(found),
        tally=Tally(
            unit="message",
            total=counts.total + counts.broken,
            kept=retained,
            refused=counts.broken,
            not_needed=counts.total - retained,
        ),
        sources=sources,
    )


def _sane(streams: Sequence[Stream], found: list[Finding]) -> tuple[list[Stream], int]:
    """Return the streams without messages of impossible times, and without infinite numbers."""
    streams = [stream for stream in streams if stream.time_us.size and stream.columns]
    if not streams:
        return [], 0
    middle_us = float(np.median(np.concatenate([stream.time_us for stream in streams])))
    retained, strange, infinite = [], 0, 0
    for stream in streams:
        good = np.abs(stream.time_us.astype(float) - middle_us) < LONGEST_LOG_US
        good &= (stream.time_us >= 0) & (stream.time_us < 1 << 53)
        strange += int(np.count_nonzero(~good))
        columns = {name: values[good] for name, values in stream.columns.items()}
        for values in columns.values():
            endless = np.isinf(values)
            infinite += int(np.count_nonzero(endless))
            values[endless] = np.nan
        if good.any():
            retained.append(replace(stream, time_us=stream.time_us[good], columns=columns))
    retained = [_without_blank(stream, found) for stream in retained]
    retained = [stream for stream in retained if stream.columns]
    if strange:
        words = f"{counted(strange, 'message')} stamped days away from the others"
        found.append(Finding("refused", "stray time", words, "time_s", strange))
    if infinite:
        words = f"{counted(infinite, 'value')} that read infinity are blank now"
        found.append(Finding("repaired", "infinite numbers", words, count=infinite))
    return retained, strange


def _without_blank(stream: Stream, found: list[Finding]) -> Stream:
    blank = [name for name, values in stream.columns.items() if np.isnan(values).all()]
    if not blank:
        return stream
    words = f"{stream.source} holds no number for it"
    found += [Finding("lacks", "blank channel", words, name) for name in blank]
    left = {name: values for name, values in stream.columns.items() if name not in blank}
    return replace(stream, columns=left)


def _gaps(streams: Sequence[Stream]) -> list[Finding]:
    for stream in streams:
        if "theta_rad" in stream.columns and stream.time_us.size > 1:
            steps_s = 1e-6 * np.diff(np.sort(stream.time_us)).astype(float)
            many = int(np.count_nonzero(steps_s > LONG_GAP_S))
            if many:
                words = (
                    f"{counted(many, 'gap')} of more than {LONG_GAP_S:g} s in the attitude, the "
                    f"longest {steps_s.max():.4g} s"
                )
                return [Finding("doubt", "gaps", words, "theta_rad", many)]
    return []


def angles_of(w: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array, Array]:
    """Return roll, pitch (nose up) and yaw of quaternions (n,) from body to earth, z down: rad.

    A quaternion of zeros, which some logs hold before the first estimate, gives nan.
    """
    size = np.sqrt(w * w + x * x + y * y + z * z)
    none = ~(size > 0.5)
    size = np.where(none, 1.0, size)
    w, x, y, z = w / size, x / size, y / size, z / size
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return tuple(np.where(none, np.nan, angle) for angle in (roll, pitch, yaw))  # type: ignore[return-value]


def reference_stream(
    source: str, time_us: Times, quaternion: Sequence[Array], field: str
) -> Stream:
    """Return the wanted attitude of quaternions from body to earth, w first."""
    roll, pitch, yaw = angles_of(*quaternion)
    columns = {"theta_ref_rad": -pitch, "roll_ref_rad": roll, "yaw_ref_rad": yaw}
    return Stream(source, time_us, columns, dict.fromkeys(columns, field))


def stream_of(
    source: str, time_us: Times, scales: Scales, numbers: Callable[[str], Array | None]
) -> list[Stream]:
    """Return one kind of message as a stream of those fields that it has; none without any.

    Args:
        source: the message's name, for people.
        time_us: (m,) on the log's clock.
        scales: what each channel is read from.
        numbers: gives a field (m,), a fresh array; None where the message has no such field.
    """
    columns, fields = {}, {}
    for channel, (field, scale) in scales.items():
        values = numbers(field)
        if values is not None:
            columns[channel] = values if scale == 1.0 else values * scale
            fields[channel] = field
    return [Stream(source, time_us, columns, fields)] if columns else []


def looking_down(orientation: Array, findings: list[Finding]) -> NDArray[np.bool_] | None:
    """Return which readings (m,) are of a sensor that looks down; None, and a finding, for none."""
    down = orientation == LOOKS_DOWN
    if down.any():
        return np.asarray(down)
    words = f"{counted(down.size, 'reading')} of sensors that do not look down"
    findings.append(Finding("left out", "distance", words, "distance_m", down.size))
    return None


def blank_bad(
    stream: Stream, channel: str, bad: NDArray[np.bool_], words: str, findings: list[Finding]
) -> None:
    """Blank readings that the sensor itself reports as bad (m,); `words` says how it calls them."""
    stream.columns[channel][bad] = np.nan
    if many := int(np.count_nonzero(bad)):
        what = "distance" if channel == "distance_m" else "rpm"
        words = f"{counted(many, 'reading')} that {words}, blank now"
        findings.append(Finding("repaired", what, words, channel, many))


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
