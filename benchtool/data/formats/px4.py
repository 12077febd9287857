"""Pitch recordings from PX4 logs (.ulg), by pyulog."""

from __future__ import annotations

import contextlib
import io
import struct
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from benchtool.core.errors import FileFormatError
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.data.formats.flight_log import (
    LOOKS_DOWN,
    MessageLog,
    Messages,
    Stream,
    import_flight_log,
    motor_outputs,
    parse_motor_map,
)
from benchtool.data.repairs.import_result import Finding, ImportResult

WANTED = (  # topics that are read; others are only counted
    *("vehicle_attitude", "vehicle_attitude_setpoint", "vehicle_angular_velocity"),
    *("vehicle_rates_setpoint", "sensor_combined", "actuator_outputs", "actuator_motors"),
    *("esc_status", "battery_status", "distance_sensor"),
)

MIN_PULSE_US, MAX_PULSE_US = 700.0, 2600.0  # DShot counts to 1999, simulators to 1
MOTORS = {101 + i: 1 + i for i in range(12)}  # motor number by output function

_FAULTS = (  # exceptions of pyulog on corrupt files, in addition to ULogException
    *(struct.error, IndexError, KeyError, ValueError, TypeError, AttributeError, OverflowError),
    *(RecursionError, MemoryError, EOFError),
)


def read_px4(data: bytes, where: str) -> ImportResult:
    """Return a PX4 log as a pitch recording."""
    from pyulog import ULog
    from pyulog.exceptions import ULogException

    readable, log = walk_ulog(data)
    findings = log.findings
    if not readable:
        reason = "; ".join(item.words for item in findings) or "it ends before its first message"
        raise FileFormatError(where, f"nothing in it can be read: {reason}")
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            ulog = ULog(io.BytesIO(readable), list(WANTED), disable_str_exceptions=True)
    except (ULogException, *_FAULTS) as error:
        raise FileFormatError(
            where, f"its definitions are broken ({error}), so nothing in it can be read"
        ) from error
    if ulog.file_corruption:
        text = "pyulog skipped messages that contradict their definitions"
        findings.append(Finding("refused", "corrupt messages", text))
    if ulog.dropouts:
        lost_s = 1e-3 * sum(dropout.duration for dropout in ulog.dropouts)
        text = f"{pluralize(len(ulog.dropouts), 'dropout')} of the logger, {lost_s:.3g} s in total"
        findings.append(Finding("doubt", "dropouts", text, count=len(ulog.dropouts)))
    kinds = {
        f"{topic.name}/{topic.multi_id}" if topic.multi_id else topic.name: _messages(topic)
        for topic in sorted(ulog.data_list, key=lambda topic: topic.multi_id)
    }
    log = replace(log, kinds=kinds)
    streams = [
        *log["vehicle_attitude"].attitude("q"),
        *_attitude_setpoint(log["vehicle_attitude_setpoint"]),
        *_rates(log),
        *_outputs(log["actuator_outputs"], _motors(ulog.initial_parameters), findings),
        *_shares(log["actuator_motors"]),
        *_speeds(log["esc_status"]),
        *_battery(log["battery_status"]),
        *_distance(log),
    ]
    n_used = sum(stream.time_us.size for stream in streams)
    # pyulog may read one part of a log with appended data twice.
    log = replace(log, total=max(log.total, n_used))
    return import_flight_log(log, streams, where, _device(ulog))


def _messages(topic: Any) -> Messages:
    fields = {name: np.asarray(values) for name, values in topic.data.items()}
    time_us = fields["timestamp"].astype(np.int64) if "timestamp" in fields else None
    return Messages(topic.name, time_us, fields)


def _motors(parameters: Mapping[str, Any]) -> dict[int, int]:
    """Return motor number by output channel (from 1), of the first group with motors."""
    numbers = {str(name): float(x) for name, x in parameters.items() if isinstance(x, int | float)}
    for outputs in ("PWM_MAIN", "PWM_AUX", "HIL_ACT"):
        if motor_map := parse_motor_map(numbers, rf"{outputs}_FUNC(\d+)", MOTORS):
            return motor_map
    return {}


def _device(log: Any) -> str:
    try:
        version = log.get_version_info_str() or ""
    except _FAULTS:
        version = ""
    hardware = log.msg_info_dict.get("ver_hw", "")
    return " ".join(filter(None, ("PX4", version, str(hardware))))


def _attitude_setpoint(messages: Messages) -> list[Stream]:
    """Return the attitude setpoint: the quaternion, or the angles of older logs."""
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
        if streams := log[name].stream(scales):
            break
    return [*streams, *log["vehicle_rates_setpoint"].stream({"gyro_ref_rad_s": ("pitch", -1.0)})]


def _outputs(messages: Messages, motors: dict[int, int], findings: list[Finding]) -> list[Stream]:
    """Return pulse widths of outputs that are pulse widths."""
    used = _max_value(messages, "noutputs")
    outputs = {
        n: f"output[{n - 1}]" for n in range(1, 17) if (n in motors if motors else n <= used)
    }
    outputs = {n: field for n, field in outputs.items() if messages.has(field)}
    pulsed = {n: field for n, field in outputs.items() if _has_pulses(messages.numbers(field))}
    if pulsed:
        return motor_outputs(messages, pulsed, motors, "PWM_MAIN_FUNCn", findings)
    if outputs:
        text = "outputs are not pulse widths (DShot or a simulator), so there is no pwm"
        findings.append(Finding("left out", "outputs", text, count=len(outputs)))
    return []


def _has_pulses(values: Array) -> bool:
    turning = values[values > 0.0]
    return bool(turning.size and np.all((turning > MIN_PULSE_US) & (turning < MAX_PULSE_US)))


def _shares(messages: Messages) -> list[Stream]:
    """Return shares of full thrust, if logged."""
    logged = [n for n in range(12) if messages.has(f"control[{n}]")]
    finite = [n for n in logged if np.isfinite(messages.numbers(f"control[{n}]")).any()]
    return messages.stream({f"motor{n + 1}_share": (f"control[{n}]", 1.0) for n in finite})


def _speeds(messages: Messages) -> list[Stream]:
    scales: dict[str, tuple[str, float]] = {}
    for n in range(min(_max_value(messages, "esc_count"), 12)):
        if messages.has(f"esc[{n}].esc_rpm"):
            motor = _max_value(messages, f"esc[{n}].actuator_function") - 100
            rotor = motor if 1 <= motor <= 12 else n + 1
            scales.setdefault(f"rpm{rotor}", (f"esc[{n}].esc_rpm", 1.0))
    return messages.stream(scales)


def _max_value(messages: Messages, field: str) -> int:
    """Return the largest number of a field, or 0 without the field."""
    return int(np.max(messages.fields.get(field, np.zeros(1)), initial=0))


def _battery(messages: Messages) -> list[Stream]:
    """Return voltage and current; a current of -1 means unknown."""
    streams = messages.stream({"voltage_V": ("voltage_v", 1.0), "current_A": ("current_a", 1.0)})
    for stream in streams:
        if "current_A" in stream.columns:
            stream.columns["current_A"][stream.columns["current_A"] == -1.0] = np.nan
    return streams


def _distance(log: MessageLog) -> list[Stream]:
    sensors = [messages for messages in log.kinds.values() if messages.source == "distance_sensor"]
    for sensor in sensors:
        if sensor.has("orientation") and not np.all(sensor.numbers("orientation") == LOOKS_DOWN):
            continue
        streams = sensor.stream({"distance_m": ("current_distance", 1.0)})
        if streams and sensor.has("signal_quality"):
            is_bad = sensor.numbers("signal_quality") == 0
            reason = "the sensor reports as invalid"
            streams[0].blank("distance_m", is_bad, reason, log.findings)
        return streams
    if sensors:
        text = "no distance sensor that looks down"
        log.findings.append(Finding("left out", "distance", text, "distance_m", len(sensors)))
    return []


HEADER_BYTES = 16
_KINDS = frozenset(b"FDIMPQARSOLCB")  # message types of PX4's ULog format, version 1

_DATA = ord("D")
_BODY = frozenset(b"ALCD")  # types that occur only after all definitions
MAX_MESSAGE_BYTES = 10_000  # as in pyulog
WHOLE_RUN = 8  # consecutive valid messages required to resume reading; assumed


def walk_ulog(data: bytes) -> tuple[bytes, MessageLog]:
    """Return a log's complete messages, skipping corrupt bytes, and their counts.

    Without complete definitions no message is returned.

    pyulog gets complete messages only: it ignores corrupt ones silently and may not return if
    definitions are corrupt.
    """
    offset, size, messages, broken = HEADER_BYTES, len(data), 0, 0
    begin, pieces, gaps = 0, [], []
    has_body = False
    kinds, body, is_data, max_bytes = _KINDS, _BODY, _DATA, MAX_MESSAGE_BYTES
    findings: list[Finding] = []
    while offset + 3 <= size:
        kind, length = data[offset + 2], data[offset] + (data[offset + 1] << 8)
        next_offset = offset + 3 + length
        if kind not in kinds or not 0 < length < max_bytes:
            pieces.append(data[begin:offset])
            if not has_body:
                text = f"the definitions are corrupt at byte {offset:,} of {size:,}"
                findings.append(Finding("refused", "corrupt bytes", text))
                begin = offset = size
                break
            begin = _next_run(data, offset + 1)
            gaps.append((offset, begin - offset))
            offset = begin
            continue
        if next_offset > size:
            break
        has_body = has_body or kind in body
        messages += kind == is_data
        offset = next_offset
    pieces.append(data[begin:offset])
    if gaps:
        lost = sum(length for _, length in gaps)
        text = (
            f"{lost:,} bytes in {pluralize(len(gaps), 'place')} are not messages, first at byte "
            f"{gaps[0][0]:,}; skipped to the next {WHOLE_RUN} valid messages"
        )
        findings.append(Finding("refused", "corrupt bytes", text))
    if offset < size:
        broken = int(offset + 2 < size and data[offset + 2] == is_data)
        text = f"the log ends at byte {size:,} in the middle of a message that begins at {offset:,}"
        findings.append(Finding("refused", "cut off", text, count=broken))
    log = MessageLog(total=messages, broken=broken, findings=findings)
    return b"".join(pieces) if has_body else b"", log


def _next_run(data: bytes, offset: int) -> int:
    """Return the offset of the next consecutive valid messages, or the end."""
    size = len(data)
    for start in range(offset, size - 2):
        end = start
        for _ in range(WHOLE_RUN):
            if end == size:
                return start
            if end + 3 > size or data[end + 2] not in _KINDS:
                break
            length = data[end] + (data[end + 1] << 8)
            if not 0 < length < MAX_MESSAGE_BYTES:
                break
            end += 3 + length
        else:
            if end <= size:
                return start
    return size
