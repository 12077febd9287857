"""Take from a PX4 log (.ulg) what a pitch recording needs; pyulog reads it."""

from __future__ import annotations

import contextlib
import io
import struct
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.errors import FileFormatError
from benchtool.core.plural import pluralize
from benchtool.data.formats.flight_log import flight_import, logged_motors, motors_of
from benchtool.data.formats.messages import LOOKS_DOWN, MessageLog, Messages, Stream
from benchtool.data.repairs.import_result import Finding, ImportOptions, ImportResult

WANTED = (  # topics that are read; the others are counted only
    "vehicle_attitude",
    "vehicle_attitude_setpoint",
    "vehicle_angular_velocity",
    "vehicle_rates_setpoint",
    "sensor_combined",
    "actuator_outputs",
    "actuator_motors",
    "esc_status",
    "battery_status",
    "distance_sensor",
)

LEAST_PULSE_US, MOST_PULSE_US = 700.0, 2600.0  # DShot counts to 1999, simulators to 1
MOTORS = {101 + i: 1 + i for i in range(12)}  # Motor number by output function

_FAULTS = (  # what pyulog lets through on broken files, beside its own exceptions
    *(struct.error, IndexError, KeyError, ValueError, TypeError, AttributeError, OverflowError),
    *(RecursionError, MemoryError, EOFError),
)


def read_px4(
    data: bytes, where: str, provenance: Mapping[str, str], options: ImportOptions
) -> ImportResult:
    """Return a PX4 log as a pitch recording."""
    from pyulog import ULog
    from pyulog.exceptions import ULogException

    walk = walk_ulog(data)
    findings = walk.findings
    if not walk.has_definitions:
        reason = "; ".join(item.words for item in findings) or "it ends before its first message"
        raise FileFormatError(where, f"nothing in it can be read: {reason}")
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            read = ULog(io.BytesIO(walk.whole), list(WANTED), disable_str_exceptions=True)
    except (ULogException, *_FAULTS) as error:
        raise FileFormatError(
            where, f"its definitions are broken ({error}), so nothing in it can be read"
        ) from error
    if read.file_corruption:
        words = "pyulog met messages that their definitions do not fit, and passed them over"
        findings.append(Finding("refused", "corrupt messages", words))
    if read.dropouts:
        lost_s = 1e-3 * sum(item.duration for item in read.dropouts)
        words = (
            f"{pluralize(len(read.dropouts), 'time')} the logger fell behind, {lost_s:.3g} s in all"
        )
        findings.append(Finding("doubt", "dropouts", words, count=len(read.dropouts)))
    kinds = {
        f"{item.name}/{item.multi_id}" if item.multi_id else item.name: _messages(item)
        for item in sorted(read.data_list, key=lambda item: item.multi_id)
    }
    log = MessageLog(kinds=kinds, total=walk.total, broken=walk.broken, findings=findings)
    streams = [
        *log["vehicle_attitude"].attitude("q"),
        *_wanted_attitude(log["vehicle_attitude_setpoint"]),
        *_rates(log),
        *_outputs(log["actuator_outputs"], _motors(read.initial_parameters), findings),
        *_shares(log["actuator_motors"]),
        *_speeds(log["esc_status"]),
        *_battery(log["battery_status"]),
        *_distance(log),
    ]
    stored = sum(stream.time_us.size for stream in streams)
    # A log with data appended has its messages in two parts, of which pyulog may read one twice.
    log = replace(log, total=max(walk.total, stored))
    return flight_import(log, streams, "PX4 ULog", where, {**provenance, "device": _device(read)})


def _messages(topic: Any) -> Messages:
    fields = {name: np.asarray(values) for name, values in topic.data.items()}
    time_us = fields["timestamp"].astype(np.int64) if "timestamp" in fields else None
    return Messages(topic.name, time_us, fields)


def _motors(parameters: Mapping[str, Any]) -> dict[int, int]:
    """Return motor number by output channel (from 1), of the first outputs that have motors."""
    numbers = {str(name): float(x) for name, x in parameters.items() if isinstance(x, int | float)}
    for outputs in ("PWM_MAIN", "PWM_AUX", "HIL_ACT"):
        if found := motors_of(numbers, rf"{outputs}_FUNC(\d+)", MOTORS):
            return found
    return {}


def _device(log: Any) -> str:
    try:
        version = log.get_version_info_str() or ""
    except _FAULTS:
        version = ""
    hardware = log.msg_info_dict.get("ver_hw", "")
    return " ".join(filter(None, ("PX4", version, str(hardware))))


def _wanted_attitude(messages: Messages) -> list[Stream]:
    """Return the wanted attitude: the quaternion, or the angles where older logs hold those."""
    streams = messages.attitude("q_d", suffix="_ref")
    if streams and np.isfinite(streams[0].columns["theta_ref_rad"]).any():
        return streams
    return messages.stream(
        {
            "theta_ref_rad": ("pitch_body", -1.0),
            "roll_ref_rad": ("roll_body", 1.0),
            "yaw_ref_rad": ("yaw_body", 1.0),
        }
    )


def _rates(log: MessageLog) -> list[Stream]:
    for name, field in (("vehicle_angular_velocity", "xyz"), ("sensor_combined", "gyro_rad")):
        scales = {
            "gyro_rad_s": (f"{field}[1]", -1.0),
            "roll_rate_rad_s": (f"{field}[0]", 1.0),
            "yaw_rate_rad_s": (f"{field}[2]", 1.0),
        }
        if found := log[name].stream(scales):
            break
    return [*found, *log["vehicle_rates_setpoint"].stream({"gyro_ref_rad_s": ("pitch", -1.0)})]


def _outputs(messages: Messages, motors: dict[int, int], findings: list[Finding]) -> list[Stream]:
    """Return pulses where outputs are pulses."""
    used = _most(messages, "noutputs")
    channels = [
        n
        for n in range(1, 17)
        if messages.has(f"output[{n - 1}]") and (n in motors if motors else n <= used)
    ]
    pulsed = [n for n in channels if _holds_pulses(messages.numbers(f"output[{n - 1}]"))]
    if pulsed:
        chosen = logged_motors(motors, pulsed, "PWM_MAIN_FUNCn", findings)
        return messages.stream(
            {f"pwm{motor}_us": (f"output[{n - 1}]", 1.0) for n, motor in chosen.items()}
        )
    if channels:
        words = "outputs are no pulse widths (DShot, or a simulator's), so they give no pwm"
        findings.append(Finding("left out", "outputs", words, count=len(channels)))
    return []


def _holds_pulses(values: Array) -> bool:
    turning = values[values > 0.0]
    return bool(turning.size and np.all((turning > LEAST_PULSE_US) & (turning < MOST_PULSE_US)))


def _shares(messages: Messages) -> list[Stream]:
    """Return shares of full thrust where they are logged."""
    logged = [n for n in range(12) if messages.has(f"control[{n}]")]
    known = [n for n in logged if np.isfinite(messages.numbers(f"control[{n}]")).any()]
    return messages.stream({f"motor{n + 1}_share": (f"control[{n}]", 1.0) for n in known})


def _speeds(messages: Messages) -> list[Stream]:
    scales: dict[str, tuple[str, float]] = {}
    for n in range(min(_most(messages, "esc_count"), 12)):
        if messages.has(f"esc[{n}].esc_rpm"):
            motor = _most(messages, f"esc[{n}].actuator_function") - 100
            rotor = motor if 1 <= motor <= 12 else n + 1
            scales.setdefault(f"rpm{rotor}", (f"esc[{n}].esc_rpm", 1.0))
    return messages.stream(scales)


def _most(messages: Messages, field: str) -> int:
    """Return the largest number of a field; 0 without one."""
    return int(np.max(messages.fields.get(field, np.zeros(1)), initial=0))


def _battery(messages: Messages) -> list[Stream]:
    """Return voltage and current; a current of -1 means unknown."""
    streams = messages.stream({"voltage_V": ("voltage_v", 1.0), "current_A": ("current_a", 1.0)})
    for stream in streams:
        if "current_A" in stream.columns:
            stream.columns["current_A"][stream.columns["current_A"] == -1.0] = np.nan
    return streams


def _distance(log: MessageLog) -> list[Stream]:
    sensors = [item for item in log.kinds.values() if item.source == "distance_sensor"]
    for sensor in sensors:
        if sensor.has("orientation") and not np.all(sensor.numbers("orientation") == LOOKS_DOWN):
            continue
        streams = sensor.stream({"distance_m": ("current_distance", 1.0)})
        if streams and sensor.has("signal_quality"):
            bad = sensor.numbers("signal_quality") == 0
            streams[0].blank("distance_m", bad, "the sensor itself calls invalid", log.findings)
        return streams
    if sensors:
        words = "no distance sensor that looks down"
        log.findings.append(Finding("left out", "distance", words, "distance_m", len(sensors)))
    return []


HEADER_BYTES = 16
_KINDS = frozenset(b"FDIMPQARSOLCB")  # Types of messages in PX4's ULog format, version 1

_DATA = ord("D")
_BODY = frozenset(b"ALCD")  # Types that stand only after all definitions
MAX_MESSAGE_BYTES = 10_000  # No message is longer in practice; pyulog takes the same bound
WHOLE_RUN = 8  # So many messages in a row that hang together are no chance: reading goes on there


class UlogWalk(NamedTuple):
    """Hold what was met on the way through a log.

    Attributes:
        whole: the log's bytes without those that are no message.
        broken: 1 for a data message that the end cuts.
        has_definitions: every definition is whole.
    """

    whole: bytes
    total: int
    broken: int
    has_definitions: bool
    findings: list[Finding]


def walk_ulog(data: bytes) -> UlogWalk:
    """Follow the lengths of a log's messages to its end, over stretches that make no sense.

    pyulog is given whole messages only. On broken ones it reads on in silence, and where its
    definitions are broken it may never come back.
    """
    at, size, messages, broken = HEADER_BYTES, len(data), 0, 0
    begin, pieces, gaps = 0, [], []
    has_body = False
    kinds, body, is_data, longest = _KINDS, _BODY, _DATA, MAX_MESSAGE_BYTES
    findings: list[Finding] = []
    while at + 3 <= size:
        kind, length = data[at + 2], data[at] + (data[at + 1] << 8)
        after = at + 3 + length
        if kind not in kinds or not 0 < length < longest:
            pieces.append(data[begin:at])
            if not has_body:
                words = f"the definitions break at byte {at:,} of {size:,}"
                findings.append(Finding("refused", "corrupt bytes", words))
                begin = at = size
                break
            begin = _next_run(data, at + 1)
            gaps.append((at, begin - at))
            at = begin
            continue
        if after > size:
            break
        has_body = has_body or kind in body
        messages += kind == is_data
        at = after
    pieces.append(data[begin:at])
    if gaps:
        lost = sum(length for _, length in gaps)
        words = (
            f"{lost:,} bytes in {pluralize(len(gaps), 'place')} are no message, first at byte "
            f"{gaps[0][0]:,}; reading went on at the next run of messages"
        )
        findings.append(Finding("refused", "corrupt bytes", words))
    if at < size:
        broken = int(at + 2 < size and data[at + 2] == is_data)
        words = f"the log ends at byte {size:,} in the middle of a message that begins at {at:,}"
        findings.append(Finding("refused", "cut off", words, count=broken))
    return UlogWalk(b"".join(pieces), messages, broken, has_body, findings)


def _next_run(data: bytes, at: int) -> int:
    """Return where the next messages begin that hang together; the end where none do."""
    size = len(data)
    while at + 3 <= size:
        if data[at + 2] in _KINDS and _runs(data, at):
            return at
        at += 1
    return size


def _runs(data: bytes, at: int) -> bool:
    for _ in range(WHOLE_RUN):
        if at == len(data):
            return True
        if at + 3 > len(data) or data[at + 2] not in _KINDS:
            return False
        length = data[at] + (data[at + 1] << 8)
        if not 0 < length < MAX_MESSAGE_BYTES:
            return False
        at += 3 + length
    return at <= len(data)
