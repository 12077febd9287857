"""Take from a PX4 log (.ulg) what a pitch recording needs; pyulog reads it."""

from __future__ import annotations

import contextlib
import io
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array import Array
from benchtool.core.counted import counted
from benchtool.core.errors import FileFormatError
from benchtool.data.formats.flight_log import (
    LOOKS_DOWN,
    Counts,
    Scales,
    Stream,
    angles_of,
    blank_bad,
    flight_import,
    reference_stream,
    stream_of,
)
from benchtool.data.formats.motor_channels import logged_motors, px4_motors
from benchtool.data.formats.ulog_walk import walk_ulog
from benchtool.data.repairs.imported import Finding, Imported, Options

Topic = Mapping[str, Any]

WANTED = (
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
"""Topics that are read; the others are counted only."""

LEAST_PULSE_US, MOST_PULSE_US = 700.0, 2600.0
"""Outputs within are pulse widths; DShot counts 0 to 1999 and simulators shares of 1 or 1000."""

_FAULTS = (
    struct.error,
    IndexError,
    KeyError,
    ValueError,
    TypeError,
    AttributeError,
    OverflowError,
    RecursionError,
    MemoryError,
    EOFError,
)
"""What pyulog lets through on broken files, beside its own exceptions."""


def read_px4(data: bytes, where: str, provenance: Mapping[str, str], options: Options) -> Imported:
    """Return a PX4 log as a pitch recording."""
    from pyulog import ULog
    from pyulog.exceptions import ULogException

    walk = walk_ulog(data)
    if not walk.has_definitions:
        told = "; ".join(item.words for item in walk.findings) or "it ends before its first message"
        raise FileFormatError(where, f"nothing in it can be read: {told}")
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            log = ULog(io.BytesIO(walk.whole), list(WANTED), disable_str_exceptions=True)
    except (ULogException, *_FAULTS) as error:
        raise FileFormatError(
            where, f"its definitions are broken ({error}), so nothing in it can be read"
        ) from error
    findings = list(walk.findings)
    if log.file_corruption:
        words = "pyulog met messages that their definitions do not fit, and passed them over"
        findings.append(Finding("refused", "corrupt messages", words))
    if log.dropouts:
        lost_s = 1e-3 * sum(item.duration for item in log.dropouts)
        words = (
            f"{counted(len(log.dropouts), 'time')} the logger fell behind, {lost_s:.3g} s in all"
        )
        findings.append(Finding("doubt", "dropouts", words, count=len(log.dropouts)))
    topics = {(item.name, item.multi_id): item.data for item in log.data_list}
    motors = px4_motors(_parameters(log))
    streams = [
        *_attitude(topics),
        *_wanted_attitude(topics),
        *_rates(topics),
        *_outputs(topics, motors, findings),
        *_speeds(topics),
        *_battery(topics),
        *_distance(topics, findings),
    ]
    kept = sum(stream.time_us.size for stream in streams)
    # A log with data appended has its messages in two parts, of which pyulog may read one twice.
    counts = Counts(total=max(walk.data_messages, kept), broken=walk.broken)
    facts = {**provenance, "device": _device(log)}
    return flight_import(streams, "PX4 ULog", where, facts, findings, counts)


def _parameters(log: Any) -> dict[str, float]:
    return {
        str(name): float(value)
        for name, value in log.initial_parameters.items()
        if isinstance(value, int | float)
    }


def _device(log: Any) -> str:
    try:
        version = log.get_version_info_str() or ""
    except _FAULTS:
        version = ""
    hardware = log.msg_info_dict.get("ver_hw", "")
    return " ".join(filter(None, ("PX4", version, str(hardware))))


def _numbers(topic: Topic, field: str) -> Array:
    return np.asarray(topic[field]).astype(float)


def _times(topic: Topic) -> NDArray[np.int64]:
    times: NDArray[np.int64] = np.asarray(topic["timestamp"]).astype(np.int64)
    return times


def _plain(
    topics: Mapping[tuple[str, int], Topic],
    name: str,
    scales: Scales,
    instance: int = 0,
) -> list[Stream]:
    """Return fields of a topic as a stream, where the topic and any of the fields are there."""
    topic = topics.get((name, instance))
    if topic is None or "timestamp" not in topic:
        return []

    def numbers(field: str) -> Array | None:
        return _numbers(topic, field) if field in topic else None

    return stream_of(name, _times(topic), scales, numbers)


def _quaternion(topic: Topic, field: str) -> list[Array] | None:
    names = [f"{field}[{i}]" for i in range(4)]
    return [_numbers(topic, name) for name in names] if all(n in topic for n in names) else None


def _attitude(topics: Mapping[tuple[str, int], Topic]) -> list[Stream]:
    topic = topics.get(("vehicle_attitude", 0), {})
    parts = _quaternion(topic, "q")
    if parts is None or "timestamp" not in topic:
        return []
    roll, pitch, yaw = angles_of(*parts)
    columns = {"theta_rad": -pitch, "roll_rad": roll, "yaw_rad": yaw}
    return [Stream("vehicle_attitude", _times(topic), columns, dict.fromkeys(columns, "q"))]


def _wanted_attitude(topics: Mapping[tuple[str, int], Topic]) -> list[Stream]:
    """Return the wanted attitude: the quaternion, or the angles where older logs hold those."""
    name = "vehicle_attitude_setpoint"
    topic = topics.get((name, 0), {})
    parts = _quaternion(topic, "q_d")
    if parts is not None and "timestamp" in topic:
        stream = reference_stream(name, _times(topic), parts, "q_d")
        if np.isfinite(stream.columns["theta_ref_rad"]).any():
            return [stream]
    scales = {
        "theta_ref_rad": ("pitch_body", -1.0),
        "roll_ref_rad": ("roll_body", 1.0),
        "yaw_ref_rad": ("yaw_body", 1.0),
    }
    return _plain(topics, name, scales)


def _rates(topics: Mapping[tuple[str, int], Topic]) -> list[Stream]:
    for name, field in (("vehicle_angular_velocity", "xyz"), ("sensor_combined", "gyro_rad")):
        scales = {
            "gyro_rad_s": (f"{field}[1]", -1.0),
            "roll_rate_rad_s": (f"{field}[0]", 1.0),
            "yaw_rate_rad_s": (f"{field}[2]", 1.0),
        }
        if found := _plain(topics, name, scales):
            break
    return [*found, *_plain(topics, "vehicle_rates_setpoint", {"gyro_ref_rad_s": ("pitch", -1.0)})]


def _outputs(
    topics: Mapping[tuple[str, int], Topic], motors: dict[int, int], findings: list[Finding]
) -> list[Stream]:
    """Return pulses where outputs are pulses, and shares of full thrust where they are logged."""
    streams: list[Stream] = []
    topic = topics.get(("actuator_outputs", 0), {})
    used = int(np.max(topic.get("noutputs", np.array([0])), initial=0))
    channels = [
        n
        for n in range(1, 17)
        if f"output[{n - 1}]" in topic and (n in motors if motors else n <= used)
    ]
    pulsed = [n for n in channels if _holds_pulses(_numbers(topic, f"output[{n - 1}]"))]
    if pulsed:
        chosen = logged_motors(motors, pulsed, "PWM_MAIN_FUNCn", findings)
        scales = {f"pwm{motor}_us": (f"output[{n - 1}]", 1.0) for n, motor in chosen.items()}
        streams += _plain(topics, "actuator_outputs", scales)
    elif channels:
        words = "outputs are no pulse widths (DShot, or a simulator's), so they give no pwm"
        findings.append(Finding("left out", "outputs", words, count=len(channels)))
    topic = topics.get(("actuator_motors", 0), {})
    shares = {
        f"motor{n + 1}_share": (f"control[{n}]", 1.0)
        for n in range(12)
        if f"control[{n}]" in topic and np.isfinite(_numbers(topic, f"control[{n}]")).any()
    }
    return [*streams, *_plain(topics, "actuator_motors", shares)]


def _holds_pulses(values: Array) -> bool:
    turning = values[values > 0.0]
    return bool(turning.size and np.all((turning > LEAST_PULSE_US) & (turning < MOST_PULSE_US)))


def _speeds(topics: Mapping[tuple[str, int], Topic]) -> list[Stream]:
    topic = topics.get(("esc_status", 0), {})
    count = int(np.max(topic.get("esc_count", np.array([0])), initial=0))
    scales: dict[str, tuple[str, float]] = {}
    for n in range(min(count, 12)):
        field = f"esc[{n}].esc_rpm"
        if field not in topic:
            continue
        function = topic.get(f"esc[{n}].actuator_function", np.zeros(1))
        motor = int(np.max(function, initial=0)) - 100
        scales.setdefault(f"rpm{motor if 1 <= motor <= 12 else n + 1}", (field, 1.0))
    return _plain(topics, "esc_status", scales)


def _battery(topics: Mapping[tuple[str, int], Topic]) -> list[Stream]:
    """Return voltage and current; a current of -1 means unknown."""
    scales = {"voltage_V": ("voltage_v", 1.0), "current_A": ("current_a", 1.0)}
    streams = _plain(topics, "battery_status", scales)
    for stream in streams:
        if "current_A" in stream.columns:
            stream.columns["current_A"][stream.columns["current_A"] == -1.0] = np.nan
    return streams


def _distance(topics: Mapping[tuple[str, int], Topic], findings: list[Finding]) -> list[Stream]:
    instances = sorted(instance for name, instance in topics if name == "distance_sensor")
    for instance in instances:
        topic = topics["distance_sensor", instance]
        looking = topic.get("orientation")
        if looking is not None and not np.all(np.asarray(looking) == LOOKS_DOWN):
            continue
        streams = _plain(
            topics, "distance_sensor", {"distance_m": ("current_distance", 1.0)}, instance
        )
        if streams and "signal_quality" in topic:
            bad = np.asarray(topic["signal_quality"]) == 0
            blank_bad(streams[0], "distance_m", bad, "the sensor itself calls invalid", findings)
        return streams
    if instances:
        words = "no distance sensor that looks down"
        findings.append(Finding("left out", "distance", words, "distance_m", len(instances)))
    return []
