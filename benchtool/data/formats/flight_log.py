"""Messages of a flight log of any format, and pitch recordings of their streams."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import FileFormatError
from benchtool.core.recording import Recording
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.data.columns import find_channel
from benchtool.data.repairs.import_result import Finding, ImportCount, ImportResult

Times = NDArray[np.int64]

Scales = Mapping[str, tuple[str, float]]  # by channel: field and factor
LOOKS_DOWN = 25  # MAV_SENSOR_ROTATION_PITCH_270, in logs of ArduPilot and PX4

RAD = np.pi / 180.0


@dataclass(frozen=True, slots=True, eq=False)
class Stream:
    """Channels of one kind of message."""

    source: str  # the message's name in the log, for display
    time_us: Times  # (m,) on the log's clock
    columns: dict[str, Array]  # (m,) values in the channel's unit, by channel name
    fields: dict[str, str]  # the message's field by channel name, for display

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
    """Messages of one kind, as columns."""

    source: str  # the kind's name in the log, for display
    time_us: Times | None  # (m,) on the log's clock; None if the messages have no time
    fields: Mapping[str, NDArray[Any]]  # (m,) each; "name[0]" is an element of an array
    divisors: Mapping[str, float] = field(default_factory=dict)  # of numbers

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
    """Messages of a log by kind, with counts."""

    kinds: Mapping[str, Messages] = field(default_factory=dict)  # by the name of their kind
    total: int  # complete messages in the log, of any kind
    broken: int  # corrupt or incomplete messages
    findings: list[Finding]  # of the parser; the reader of the messages appends to it

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
    channels = tuple(map(find_channel, ("time_s", "device_time_us", *names)))
    disordered = sum(int(np.count_nonzero(np.diff(stream.time_us) < 0)) for stream in streams)
    return Recording(channels, values), disordered


def _rank_equal_times(time_us: Times) -> NDArray[np.intp]:
    """Return the number of earlier messages of the same time, for each message (m,)."""
    order = np.argsort(time_us, kind="stable")
    ordered, rank = time_us[order], np.empty(time_us.size, np.intp)
    rank[order] = np.arange(time_us.size) - np.searchsorted(ordered, ordered)
    return rank


MIN_GAP_S = 1.0  # dropout of the attitude, which every log has at 4 Hz or more; assumed
MAX_LOG_US = 7 * 86400e6  # messages farther from the median time are corrupt; assumed

_NEEDS: tuple[tuple[str, str, str], ...] = (  # contents, pattern of channels, message if missing
    ("attitude", r"theta_rad", "no attitude in the log, so it is not a pitch recording"),
    ("rates", r"gyro_rad_s", "no rates in the log; only differences of the attitude are available"),
    ("reference", r"theta_ref_rad", "no pitch setpoint in the log"),
    ("outputs", r"pwm\d+_us|motor\d+_share", "no motor outputs in the log"),
    ("rpm", r"rpm\d+", "no speeds of ESC or tachometer; they can only be modelled from outputs"),
    ("distance", r"distance_m", "no distance sensor in the log; --over sets the surface windows"),
)


def import_flight_log(
    log: MessageLog, streams: Sequence[Stream], where: str, device: str
) -> ImportResult:
    """Return a flight log as a pitch recording."""
    findings = list(log.findings)
    streams, strange = _clean(streams, findings)
    total, broken = log.total - strange, log.broken + strange
    if not streams:
        reasons = "; ".join(finding.words for finding in findings if finding.kind == "refused")
        raise FileFormatError(
            where,
            f"{pluralize(total, 'message')} could be read, and none is attitude, rates, outputs, "
            f"rpm or distance{': ' + reasons if reasons else ''}; use a log of a flight",
        )
    recording, disordered = merge_streams(streams)
    if disordered:
        text = f"{pluralize(disordered, 'message')} stamped before an earlier one; sorted by time"
        findings.append(Finding("repaired", "time goes backwards", text, "time_s", disordered))
    if "theta_rad" in recording or "gyro_rad_s" in recording:
        text = "theta and gyro are nose down positive, as in benchtool; logs are nose up positive"
        findings.append(Finding("read as", "sign", text, "theta_rad"))
    for what, pattern, text in _NEEDS:
        if not any(re.fullmatch(pattern, name) for name in recording.names):
            findings.append(Finding("lacks", what, text))
    findings += _gaps(streams)
    retained = sum(stream.time_us.size for stream in streams)
    sources = {
        name: f"{stream.source}.{stream.fields[name]}"
        for stream in streams
        for name in stream.columns
    }
    return ImportResult(
        recording=replace(recording, provenance={"device": device, "rows": str(len(recording))}),
        findings=tuple(findings),
        tally=ImportCount(
            unit="message",
            total=total + broken,
            kept=retained,
            refused=broken,
            not_needed=total - retained,
        ),
        sources=sources,
    )


def _clean(streams: Sequence[Stream], findings: list[Finding]) -> tuple[list[Stream], int]:
    """Return the streams without messages of impossible times, infinite numbers blanked."""
    streams = [stream for stream in streams if stream.time_us.size and stream.columns]
    if not streams:
        return [], 0
    middle_us = float(np.median(np.concatenate([stream.time_us for stream in streams])))
    retained, n_strange, n_infinite = [], 0, 0
    for stream in streams:
        is_good = np.abs(stream.time_us.astype(float) - middle_us) < MAX_LOG_US
        is_good &= (stream.time_us >= 0) & (stream.time_us < 1 << 53)
        n_strange += int(np.count_nonzero(~is_good))
        columns = {name: values[is_good] for name, values in stream.columns.items()}
        for values in columns.values():
            is_infinite = np.isinf(values)
            n_infinite += int(np.count_nonzero(is_infinite))
            values[is_infinite] = np.nan
        if is_good.any():
            retained.append(replace(stream, time_us=stream.time_us[is_good], columns=columns))
    for stream in retained:
        for name in [name for name, values in stream.columns.items() if np.isnan(values).all()]:
            text = f"{stream.source} has no number for it"
            findings.append(Finding("lacks", "blank channel", text, name))
            del stream.columns[name]
    retained = [stream for stream in retained if stream.columns]
    if n_strange:
        text = f"{pluralize(n_strange, 'message')} stamped days away from the others"
        findings.append(Finding("refused", "stray time", text, "time_s", n_strange))
    if n_infinite:
        text = f"{pluralize(n_infinite, 'infinite value')} blanked"
        findings.append(Finding("repaired", "infinite numbers", text, count=n_infinite))
    return retained, n_strange


def _gaps(streams: Sequence[Stream]) -> list[Finding]:
    for stream in streams:
        if "theta_rad" in stream.columns and stream.time_us.size > 1:
            steps_s = 1e-6 * np.diff(np.sort(stream.time_us)).astype(float)
            n_gaps = int(np.count_nonzero(steps_s > MIN_GAP_S))
            if n_gaps:
                text = (
                    f"{pluralize(n_gaps, 'gap')} of more than {MIN_GAP_S:g} s in the attitude, the "
                    f"longest {steps_s.max():.4g} s"
                )
                return [Finding("doubt", "gaps", text, "theta_rad", n_gaps)]
    return []


# SRV_Channel.h: 33..40 Motor1..8, 82..85 Motor9..12, 70 throttle, 73 and 74 left and right.
_ARDUPILOT: dict[int, int] = (
    {33 + i: 1 + i for i in range(8)} | {82 + i: 9 + i for i in range(4)} | {70: 1, 73: 1, 74: 2}
)


def ardupilot_motors(parameters: Messages, name: str, value: str) -> dict[int, int]:
    """Return motor number by output channel (from 1), from messages with parameters."""
    if not parameters.has(name, value):
        return {}
    pairs = zip(parameters.texts(name), parameters.numbers(value).tolist(), strict=True)
    return parse_motor_map(dict(pairs), r"SERVO(\d+)_FUNCTION", _ARDUPILOT)


def parse_motor_map(
    parameters: Mapping[str, float], pattern: str, functions: Mapping[int, int]
) -> dict[int, int]:
    """Return motor number by output channel (from 1), in the order of the motors.

    `pattern` matches parameters that set a channel's function; its group is the channel.
    """
    motor_map: dict[int, int] = {}
    for name, number in parameters.items():
        match = re.fullmatch(pattern, name)
        if match and number == number and abs(number) < 1e6 and int(number) in functions:
            motor = functions[int(number)]
            if motor not in motor_map.values():
                motor_map[int(match[1])] = motor
    return dict(sorted(motor_map.items(), key=lambda pair: pair[1]))


def motor_outputs(
    messages: Messages,
    fields: Mapping[int, str],
    motors: Mapping[int, int],
    parameter: str,
    findings: list[Finding],
) -> list[Stream]:
    """Return the pulse widths of the motors, with a finding about the assignment.

    Args:
        fields: of logged output channels, by channel.
        motors: motor number by channel from parameters; if empty, motor n is channel n.
    """
    if not motors:
        text = (
            f"no {parameter} assigns channels to motors; pwm1 is channel 1, and a channel may "
            f"drive a servo"
        )
        findings.append(Finding("doubt", "motor channels", text))
        return messages.stream({f"pwm{n}_us": (field, 1.0) for n, field in fields.items()})
    pairs = ", ".join(f"motor {motor} on channel {channel}" for channel, motor in motors.items())
    text = f"{pairs}; rotors have the autopilot's motor numbers, not a rig's"
    findings.append(Finding("read as", "motor channels", text))
    for channel, motor in motors.items():
        if channel not in fields:
            text = f"motor {motor} is on channel {channel}, which has no pulse width in the log"
            findings.append(Finding("lacks", "outputs", text, f"pwm{motor}_us"))
    return messages.stream(
        {f"pwm{motor}_us": (fields[n], 1.0) for n, motor in motors.items() if n in fields}
    )
