"""Make a pitch recording of a flight log's streams, and say what the log lacks for one."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.counted import counted
from benchtool.core.errors import FileFormatError
from benchtool.data.formats.streams import Stream, merged
from benchtool.data.repairs.imported import Finding, Imported, Tally

Array = NDArray[np.float64]

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
    kept = sum(stream.time_us.size for stream in streams)
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
            kept=kept,
            refused=counts.broken,
            not_needed=counts.total - kept,
        ),
        sources=sources,
    )


def _sane(streams: Sequence[Stream], found: list[Finding]) -> tuple[list[Stream], int]:
    """Return the streams without messages of impossible times, and without infinite numbers."""
    streams = [stream for stream in streams if stream.time_us.size and stream.columns]
    if not streams:
        return [], 0
    middle_us = float(np.median(np.concatenate([stream.time_us for stream in streams])))
    kept, strange, infinite = [], 0, 0
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
            kept.append(replace(stream, time_us=stream.time_us[good], columns=columns))
    kept = [_without_blank(stream, found) for stream in kept]
    kept = [stream for stream in kept if stream.columns]
    if strange:
        words = f"{counted(strange, 'message')} stamped days away from the others"
        found.append(Finding("refused", "stray time", words, "time_s", strange))
    if infinite:
        words = f"{counted(infinite, 'value')} that read infinity are blank now"
        found.append(Finding("repaired", "infinite numbers", words, count=infinite))
    return kept, strange


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
