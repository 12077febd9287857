"""Take from a MAVLink telemetry log (.tlog) what a pitch recording needs."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array import Array
from benchtool.core.counted import counted
from benchtool.core.errors import FileFormatError
from benchtool.data.formats.autopilot_clock import AutopilotClock
from benchtool.data.formats.flight_log import (
    Counts,
    Scales,
    Stream,
    flight_import,
    looking_down,
    reference_stream,
    stream_of,
)
from benchtool.data.formats.mavlink_walk import Frame, walk_tlog
from benchtool.data.formats.motor_channels import ardupilot_motors, logged_motors
from benchtool.data.repairs.imported import Finding, Imported, Options

_ESC_GROUPS = ("1_TO_4", "5_TO_8", "9_TO_12")
WANTED = (
    *("ATTITUDE", "ATTITUDE_TARGET", "NAV_CONTROLLER_OUTPUT", "SERVO_OUTPUT_RAW", "RPM"),
    *(f"ESC_TELEMETRY_{group}" for group in _ESC_GROUPS),
    *("DISTANCE_SENSOR", "RANGEFINDER", "SYS_STATUS", "PARAM_VALUE", "HEARTBEAT"),
)
"""Messages that are read, beside ESC_STATUS; the others are counted only."""

_DEG = np.pi / 180.0


@dataclass(frozen=True, slots=True)
class Shape:
    """Hold how one kind of message is packed: its number, checksum seed, struct and fields.

    Attributes:
        fields: name to the position of its first number in the unpacked message.
    """

    number: int
    crc_extra: int
    unpacker: struct.Struct
    fields: Mapping[str, int]


_ESC_STATUS = Shape(
    291, 10, struct.Struct("<Q4i4f4fB"), {"time_usec": 0, "rpm": 1, "voltage": 5, "index": 13}
)
"""PX4's speeds (MAVLink common.xml), which pymavlink's ArduPilot dialect lacks (2.4.50)."""


@dataclass(frozen=True, slots=True, eq=False)
class Messages:
    """Hold the messages of one kind: (m,) times, and the unpacked numbers of each."""

    time_us: NDArray[np.int64]
    rows: list[tuple[Any, ...]]
    fields: Mapping[str, int]

    def where(self, chosen: NDArray[np.bool_]) -> Messages:
        """Return the chosen messages (m,)."""
        rows = [row for row, wanted in zip(self.rows, chosen.tolist(), strict=True) if wanted]
        return Messages(self.time_us[chosen], rows, self.fields)

    def numbers(self, field: str, index: int = 0) -> Array:
        """Return one field (m,), or one element of an array field."""
        at = self.fields[field] + index
        return np.array([row[at] for row in self.rows], float)


def read_mavlink(
    data: bytes, where: str, provenance: Mapping[str, str], options: Options
) -> Imported:
    """Return a telemetry log as a pitch recording, on the autopilot's clock."""
    shapes, checksum = _shapes()
    walk = walk_tlog(data, {item.number: item.crc_extra for item in shapes.values()}, checksum)
    findings = list(walk.findings)
    system = _vehicle(walk.frames, shapes, findings)
    if system is None:
        raise FileFormatError(
            where, f"no vehicle speaks in it ({counted(walk.total, 'frame')}); name another log"
        )
    log = {name: _messages(walk.frames[item.number], item, system) for name, item in shapes.items()}
    log = _on_one_clock(log, findings)
    motors = _motors(log["PARAM_VALUE"])
    streams = [
        *_attitude(log["ATTITUDE"]),
        *_wanted(log),
        *_outputs(log["SERVO_OUTPUT_RAW"], motors, findings),
        *_speeds(log),
        *_battery(log["SYS_STATUS"]),
        *_distance(log, findings),
    ]
    facts = {**provenance, "device": f"MAVLink system {system[0]}, component {system[1]}"}
    counts = Counts(total=walk.total, broken=walk.broken)
    return flight_import(streams, "MAVLink tlog", where, facts, findings, counts)


def _shapes() -> tuple[dict[str, Shape], Any]:
    """Return the wanted messages as pymavlink knows them, and its checksum."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    by_name = {item.msgname: item for item in dialect.mavlink_map.values()}
    shapes = {"ESC_STATUS": _ESC_STATUS}
    for name in WANTED:
        known = by_name[name]
        first = np.concatenate([[0], np.cumsum(known.lengths)])
        fields = {
            field: int(first[order])
            for field, order in zip(known.fieldnames, known.orders, strict=True)
        }
        shapes[name] = Shape(known.id, known.crc_extra, known.unpacker, fields)

    def checksum(text: bytes) -> int:
        return int(dialect.x25crc(text).crc)

    return shapes, checksum


def _vehicle(
    frames: Mapping[int, list[Frame]], shapes: Mapping[str, Shape], findings: list[Finding]
) -> tuple[int, int] | None:
    """Return the system and component that tells most attitudes, or that beats at all."""
    for name in ("ATTITUDE", "SERVO_OUTPUT_RAW", "HEARTBEAT"):
        spoken = Counter((item.system, item.component) for item in frames[shapes[name].number])
        if spoken:
            (chosen, _), *others = spoken.most_common()
            if others and name != "HEARTBEAT":
                listed = ", ".join(f"{pair[0]}/{pair[1]}" for pair, _ in others)
                words = f"{name} of system {chosen[0]}/{chosen[1]} is read; {listed} left out"
                findings.append(Finding("left out", "other systems", words))
            return chosen
    return None


def _messages(frames: list[Frame], shape: Shape, system: tuple[int, int]) -> Messages:
    size = shape.unpacker.size
    own = [item for item in frames if (item.system, item.component) == system]
    # MAVLink 2 leaves zeros at a payload's end out; newer fields stand behind the known ones.
    rows = [shape.unpacker.unpack(item.payload[:size].ljust(size, b"\0")) for item in own]
    return Messages(np.array([item.time_us for item in own], np.int64), rows, shape.fields)


def _stream(source: str, messages: Messages, scales: Scales, *, index: int = 0) -> list[Stream]:
    if not messages.rows:
        return []
    return stream_of(source, messages.time_us, scales, lambda field: messages.numbers(field, index))


def _on_one_clock(log: Mapping[str, Messages], findings: list[Finding]) -> dict[str, Messages]:
    """Return the messages with times on the autopilot's clock."""
    attitude = log["ATTITUDE"]
    if not attitude.rows:
        words = "no attitude tells the autopilot's clock; times are the host's stamps"
        findings.append(Finding("doubt", "time", words, "time_s"))
        return dict(log)
    clock = AutopilotClock.of(attitude.time_us, attitude.numbers("time_boot_ms"))
    delay_ms = 1e-3 * (attitude.time_us - clock.boot_us).astype(float)
    low, high = np.percentile(delay_ms, [5.0, 95.0])
    words = (
        f"the autopilot's clock, not the host's stamps, which scatter by {high - low:.3g} ms "
        f"against it; speeds and battery carry none and are interpolated"
    )
    findings.append(Finding("read as", "time", words, "time_s"))
    if clock.starts:
        words = f"the autopilot booted anew {counted(len(clock.starts), 'time')}; time goes on"
        findings.append(Finding("repaired", "time starts anew", words, "time_s", len(clock.starts)))
    timed = {}
    for name, messages in log.items():
        if "time_boot_ms" in messages.fields and messages.rows:
            times = clock.of_boot_ms(messages.time_us, messages.numbers("time_boot_ms"))
        elif name == "SERVO_OUTPUT_RAW" and messages.rows:
            times = clock.of_wrapped_us(messages.time_us, messages.numbers("time_usec"))
        else:
            times = clock.of_host(messages.time_us)
        timed[name] = replace(messages, time_us=times)
    return timed


def _attitude(messages: Messages) -> list[Stream]:
    scales = {
        "theta_rad": ("pitch", -1.0),
        "gyro_rad_s": ("pitchspeed", -1.0),
        "roll_rad": ("roll", 1.0),
        "roll_rate_rad_s": ("rollspeed", 1.0),
        "yaw_rad": ("yaw", 1.0),
        "yaw_rate_rad_s": ("yawspeed", 1.0),
    }
    return _stream("ATTITUDE", messages, scales)


def _wanted(log: Mapping[str, Messages]) -> list[Stream]:
    """Return the wanted attitude and rate: the target where it is sent, else navigation's."""
    target = log["ATTITUDE_TARGET"]
    if target.rows:
        parts = [target.numbers("q", i) for i in range(4)]
        stream = reference_stream("ATTITUDE_TARGET", target.time_us, parts, "q")
        stream.columns["gyro_ref_rad_s"] = -target.numbers("body_pitch_rate")
        stream.fields["gyro_ref_rad_s"] = "body_pitch_rate"
        return [stream]
    scales = {"theta_ref_rad": ("nav_pitch", -_DEG), "roll_ref_rad": ("nav_roll", _DEG)}
    return _stream("NAV_CONTROLLER_OUTPUT", log["NAV_CONTROLLER_OUTPUT"], scales)


def _motors(messages: Messages) -> dict[int, int]:
    at = messages.fields["param_id"]
    names = [bytes(row[at]).split(b"\0")[0].decode("latin-1") for row in messages.rows]
    values = messages.numbers("param_value").tolist()
    return ardupilot_motors(dict(zip(names, values, strict=True)))


def _outputs(messages: Messages, motors: dict[int, int], findings: list[Finding]) -> list[Stream]:
    if not messages.rows:
        return []
    own = messages.where(messages.numbers("port") == 0.0)
    if not own.rows:
        return []
    channels = [n for n in range(1, 17) if np.any(own.numbers(f"servo{n}_raw") > 0.0)]
    chosen = logged_motors(motors, channels, "SERVOn_FUNCTION", findings)
    scales = {f"pwm{motor}_us": (f"servo{channel}_raw", 1.0) for channel, motor in chosen.items()}
    return _stream("SERVO_OUTPUT_RAW", own, scales) if scales else []


def _speeds(log: Mapping[str, Messages]) -> list[Stream]:
    streams: list[Stream] = []
    for group, name in enumerate(f"ESC_TELEMETRY_{item}" for item in _ESC_GROUPS):
        messages = log[name]
        for index in range(4):
            if messages.rows and np.any(messages.numbers("rpm", index) > 0.0):
                scales = {f"rpm{4 * group + index + 1}": ("rpm", 1.0)}
                streams += _stream(name, messages, scales, index=index)
    if streams:
        return _one_each(streams)
    status = log["ESC_STATUS"]
    bases = status.numbers("index").astype(int) if status.rows else np.zeros(0, int)
    for base in sorted({base for base in bases.tolist() if 0 <= base < 32}):
        own = status.where(bases == base)
        for index in range(4):
            if np.any(own.numbers("rpm", index) != 0.0):
                scales = {f"rpm{base + index + 1}": ("rpm", 1.0)}
                streams += _stream("ESC_STATUS", own, scales, index=index)
    if streams:
        return _one_each(streams)
    return _stream("RPM", log["RPM"], {"rpm1": ("rpm1", 1.0), "rpm2": ("rpm2", 1.0)})


def _one_each(streams: list[Stream]) -> list[Stream]:
    """Join streams of the same messages, so that a message counts once; first speeds win."""
    joined: list[Stream] = []
    taken: set[str] = set()
    for stream in streams:
        columns = {name: values for name, values in stream.columns.items() if name not in taken}
        taken |= set(columns)
        last = joined[-1] if joined else None
        if last is not None and np.array_equal(last.time_us, stream.time_us):
            last.columns.update(columns)
            last.fields.update({name: stream.fields[name] for name in columns})
        elif columns:
            joined.append(stream)
    return joined


def _battery(messages: Messages) -> list[Stream]:
    """Return voltage and current; 65535 mV and -1 cA mean unknown, and so does 0 mV."""
    if not messages.rows:
        return []
    volts, amperes = messages.numbers("voltage_battery"), messages.numbers("current_battery")
    volts[(volts == 65535.0) | (volts == 0.0)] = np.nan
    amperes[amperes == -1.0] = np.nan
    columns = {"voltage_V": 1e-3 * volts, "current_A": 1e-2 * amperes}
    fields = {"voltage_V": "voltage_battery", "current_A": "current_battery"}
    known = {name: values for name, values in columns.items() if np.isfinite(values).any()}
    return [Stream("SYS_STATUS", messages.time_us, known, fields)] if known else []


def _distance(log: Mapping[str, Messages], findings: list[Finding]) -> list[Stream]:
    messages = log["DISTANCE_SENSOR"]
    if not messages.rows:
        return _stream("RANGEFINDER", log["RANGEFINDER"], {"distance_m": ("distance", 1.0)})
    down = looking_down(messages.numbers("orientation"), findings)
    if down is None:
        return []
    scales = {"distance_m": ("current_distance", 0.01)}
    return _stream("DISTANCE_SENSOR", messages.where(down), scales)
