"""Pitch recordings from MAVLink telemetry logs (.tlog): time stamps, frames and messages."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import FileFormatError
from benchtool.core.text import pluralize
from benchtool.data.formats.flight_log import (
    RAD,
    MessageLog,
    Messages,
    Scales,
    Stream,
    Times,
    ardupilot_motors,
    import_flight_log,
    motor_outputs,
)
from benchtool.data.repairs.import_result import Finding, ImportResult

STAMP_BYTES = 8
V1, V2 = 0xFE, 0xFD
_START = re.compile(b"[\xfe\xfd]")
SIGNATURE_BYTES = 13
_SIGNED = 0x01
MIN_STAMP_US, MAX_STAMP_US = 946684800_000000, 4102444800_000000  # 2000 to 2100


class Frame(NamedTuple):
    """Frame: time of reception by the host, system and component of the sender, payload."""

    time_us: int
    sender: tuple[int, int]
    payload: bytes


def is_tlog(data: bytes) -> bool:
    """Return whether bytes begin like a telemetry log."""
    if len(data) < STAMP_BYTES + 8 or data[STAMP_BYTES] not in (V1, V2):
        return False
    return MIN_STAMP_US <= int.from_bytes(data[:STAMP_BYTES], "big") <= MAX_STAMP_US


def walk_tlog(
    data: bytes, extras: dict[int, int], checksum: Callable[[bytes], int]
) -> tuple[dict[int, list[Frame]], MessageLog]:
    """Return the frames of the selected kinds by message number, and the counts of all frames.

    Args:
        extras: CRC_EXTRA by selected message number; others are counted without a check.
        checksum: of MAVLink, over a frame without its first byte and with CRC_EXTRA at its end.
    """
    frames: dict[int, list[Frame]] = {number: [] for number in extras}
    offset, size, total, broken, lost, first_lost = 0, len(data), 0, 0, 0, -1
    cut = ""
    while offset + STAMP_BYTES < size:
        begin = offset + STAMP_BYTES
        length = _frame_length(data, begin)
        time_us = int.from_bytes(data[offset:begin], "big")
        if not length or not MIN_STAMP_US <= time_us <= MAX_STAMP_US:
            next_offset = _next_start(data, offset + 1)
            lost += next_offset - offset
            first_lost = offset if first_lost < 0 else first_lost
            offset = next_offset
            continue
        end = begin + length
        if end > size:
            cut = f"the log ends at byte {size:,} in the middle of a frame that begins at {begin:,}"
            broken += 1
            break
        if data[begin] == V2:
            number = data[begin + 7] | data[begin + 8] << 8 | data[begin + 9] << 16
            head, system = 10, begin + 5
        else:
            number, head, system = data[begin + 5], 6, begin + 3
        extra = extras.get(number)
        if extra is not None:
            stop = begin + head + data[begin + 1]
            if (
                checksum(data[begin + 1 : stop] + bytes((extra,)))
                != data[stop] | data[stop + 1] << 8
            ):
                broken += 1
                is_start = end >= size or _frame_length(data, end + STAMP_BYTES) > 0
                offset = end if is_start else _next_start(data, offset + 1)
                continue
            frames[number].append(
                Frame(time_us, (data[system], data[system + 1]), data[begin + head : stop])
            )
        total += 1
        offset = end
    if not cut and 0 < size - offset <= STAMP_BYTES:
        cut = f"the log ends at byte {size:,} in the middle of a time stamp"
    findings = _report_losses(lost, first_lost, broken - bool(cut), cut)
    return frames, MessageLog(total=total, broken=broken, findings=findings)


def _frame_length(data: bytes, begin: int) -> int:
    """Return the length of the frame that begins here, or 0 without a frame."""
    if begin + 2 >= len(data):
        return 0
    if data[begin] == V1:
        return 8 + data[begin + 1]
    if data[begin] != V2:
        return 0
    return 12 + data[begin + 1] + (SIGNATURE_BYTES if data[begin + 2] & _SIGNED else 0)


def _next_start(data: bytes, offset: int) -> int:
    """Return the next offset of a plausible time stamp before a frame's first byte."""
    for start in _START.finditer(data, offset + STAMP_BYTES):
        offset = start.start() - STAMP_BYTES
        if MIN_STAMP_US <= int.from_bytes(data[offset : start.start()], "big") <= MAX_STAMP_US:
            return offset
    return len(data)


def _report_losses(lost: int, first_lost: int, n_wrong: int, cut: str) -> list[Finding]:
    findings = []
    if lost:
        text = f"{pluralize(lost, 'byte')} outside frames, first at byte {first_lost:,}; skipped"
        findings.append(Finding("refused", "corrupt bytes", text))
    if n_wrong > 0:
        text = f"{pluralize(n_wrong, 'frame')} with a wrong checksum"
        findings.append(Finding("refused", "corrupt frames", text, count=n_wrong))
    if cut:
        findings.append(Finding("refused", "cut off", cut, count=int("frame" in cut)))
    return findings


ATTITUDE: Scales = {
    "theta_rad": ("pitch", -1.0),
    "gyro_rad_s": ("pitchspeed", -1.0),
    "roll_rad": ("roll", 1.0),
    "roll_rate_rad_s": ("rollspeed", 1.0),
    "yaw_rad": ("yaw", 1.0),
    "yaw_rate_rad_s": ("yawspeed", 1.0),
}
_ESC_GROUPS = ("1_TO_4", "5_TO_8", "9_TO_12")
WANTED = (  # messages that are read, in addition to ESC_STATUS; others are only counted
    *("ATTITUDE", "ATTITUDE_TARGET", "NAV_CONTROLLER_OUTPUT", "SERVO_OUTPUT_RAW", "RPM"),
    *(f"ESC_TELEMETRY_{group}" for group in _ESC_GROUPS),
    *("DISTANCE_SENSOR", "RANGEFINDER", "SYS_STATUS", "PARAM_VALUE", "HEARTBEAT"),
)


class PayloadLayout:
    """Layout of one kind of message, from a struct format with the names of its parts.

    The elements of an array of numbers are separate fields: rpm[0], rpm[1] and so on.
    """

    def __init__(self, number: int, crc_extra: int, form: str, names: Sequence[str]) -> None:
        self.number, self.crc_extra = number, crc_extra
        fields: list[tuple[str, str]] = []
        for (count, letter), name in zip(re.findall(r"(\d*)([a-zA-Z])", form), names, strict=True):
            kind = f"S{count}" if letter == "s" else f"<{letter}"
            is_array = count and letter != "s"
            indices = [f"[{i}]" for i in range(int(count))] if is_array else [""]
            fields += [(f"{name}{index}", kind) for index in indices]
        self.dtype = np.dtype(fields)

    def messages(self, name: str, frames: Sequence[Frame]) -> Messages:
        """Return the payloads of frames as messages, on the host's clock."""
        size = self.dtype.itemsize
        # MAVLink 2 omits zeros at a payload's end; newer fields follow the known ones.
        packed = b"".join(frame.payload[:size].ljust(size, b"\0") for frame in frames)
        rows = np.frombuffer(packed, self.dtype)
        times = np.array([frame.time_us for frame in frames], np.int64)
        return Messages(name, times, {field: rows[field] for field in self.dtype.names or ()})


_ESC_STATUS = PayloadLayout(  # of PX4 (MAVLink common.xml); not in pymavlink 2.4.50
    291, 10, "<Q4i4f4fB", ("time_usec", "rpm", "voltage", "current", "index")
)


def read_mavlink(data: bytes, where: str) -> ImportResult:
    """Return a telemetry log as a pitch recording, on the autopilot's clock."""
    layouts, checksum = _layouts()
    extras = {item.number: item.crc_extra for item in layouts.values()}
    frames, log = walk_tlog(data, extras, checksum)
    system = _select_sender(frames, layouts, log.findings)
    if system is None:
        message = f"no messages of a vehicle ({pluralize(log.total, 'frame')}); use another log"
        raise FileFormatError(where, message)
    kinds = {
        name: layout.messages(name, [f for f in frames[layout.number] if f.sender == system])
        for name, layout in layouts.items()
    }
    log = replace(log, kinds=_convert_clocks(kinds, log.findings))
    streams = [
        *log["ATTITUDE"].stream(ATTITUDE),
        *_setpoints(log),
        *_outputs(log),
        *_speeds(log),
        *_battery(log["SYS_STATUS"]),
        *_distance(log),
    ]
    device = f"MAVLink system {system[0]}, component {system[1]}"
    return import_flight_log(log, streams, where, device)


def _layouts() -> tuple[dict[str, PayloadLayout], Any]:
    """Return the layouts of the messages that are read, and the checksum, from pymavlink."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    by_name = {definition.msgname: definition for definition in dialect.mavlink_map.values()}
    layouts = {"ESC_STATUS": _ESC_STATUS}
    for name in WANTED:
        kind = by_name[name]
        layouts[name] = PayloadLayout(
            kind.id, kind.crc_extra, kind.unpacker.format, kind.ordered_fieldnames
        )
    return layouts, lambda text: dialect.x25crc(text).crc


def _select_sender(
    frames: Mapping[int, list[Frame]], layouts: Mapping[str, PayloadLayout], findings: list[Finding]
) -> tuple[int, int] | None:
    """Return the system and component with most attitudes, or else outputs or heartbeats."""
    for name in ("ATTITUDE", "SERVO_OUTPUT_RAW", "HEARTBEAT"):
        senders = Counter(frame.sender for frame in frames[layouts[name].number])
        if senders:
            (chosen, _), *others = senders.most_common()
            if others and name != "HEARTBEAT":
                listed = ", ".join(f"{pair[0]}/{pair[1]}" for pair, _ in others)
                text = f"{name} of system {chosen[0]}/{chosen[1]} is read; {listed} left out"
                findings.append(Finding("left out", "other systems", text))
            return chosen
    return None


def _convert_clocks(kinds: dict[str, Messages], findings: list[Finding]) -> dict[str, Messages]:
    """Return the messages with times on the autopilot's clock."""
    attitude = kinds["ATTITUDE"]
    if not len(attitude) or attitude.time_us is None:
        text = "no attitude messages with autopilot time; times are the host's stamps"
        findings.append(Finding("doubt", "time", text, "time_s"))
        return kinds
    clock = AutopilotClock(attitude.time_us, attitude.numbers("time_boot_ms"))
    delay_ms = 1e-3 * (attitude.time_us - clock.boot_us).astype(float)
    low, high = np.percentile(delay_ms, [5.0, 95.0])
    text = (
        f"the autopilot's clock, not the host's stamps, which scatter by {high - low:.3g} ms "
        f"against it; speeds and battery have no autopilot time and are interpolated"
    )
    findings.append(Finding("read as", "time", text, "time_s"))
    if clock.starts:
        text = f"the autopilot rebooted {pluralize(len(clock.starts), 'time')}; time is continuous"
        findings.append(Finding("repaired", "time starts anew", text, "time_s", len(clock.starts)))
    return {name: replace(kind, time_us=_times(clock, kind)) for name, kind in kinds.items()}


def _times(clock: AutopilotClock, messages: Messages) -> Times | None:
    stamps = messages.time_us
    if stamps is None or not len(messages):
        return stamps
    if messages.has("time_boot_ms"):
        boot_us = (1000.0 * messages.numbers("time_boot_ms")).astype(np.int64)
        return boot_us + clock.offset_us(stamps)
    if messages.source == "SERVO_OUTPUT_RAW":
        return clock.time_from_wrapped_us(stamps, messages.numbers("time_usec"))
    return clock.time_from_host(stamps)


def _setpoints(log: MessageLog) -> list[Stream]:
    """Return attitude and rate setpoints: ATTITUDE_TARGET, else NAV_CONTROLLER_OUTPUT."""
    target = log["ATTITUDE_TARGET"]
    for stream in target.attitude("q", suffix="_ref"):
        stream.columns["gyro_ref_rad_s"] = -target.numbers("body_pitch_rate")
        stream.fields["gyro_ref_rad_s"] = "body_pitch_rate"
        return [stream]
    scales = {"theta_ref_rad": ("nav_pitch", -RAD), "roll_ref_rad": ("nav_roll", RAD)}
    return log["NAV_CONTROLLER_OUTPUT"].stream(scales)


def _outputs(log: MessageLog) -> list[Stream]:
    messages = log["SERVO_OUTPUT_RAW"]
    main = messages.where(messages.numbers("port") == 0.0)
    if not len(main):
        return []
    fields = {n: f"servo{n}_raw" for n in range(1, 17)}
    fields = {n: field for n, field in fields.items() if np.any(main.numbers(field) > 0.0)}
    motors = ardupilot_motors(log["PARAM_VALUE"], "param_id", "param_value")
    return motor_outputs(main, fields, motors, "SERVOn_FUNCTION", log.findings)


def _speeds(log: MessageLog) -> list[Stream]:
    streams: list[Stream] = []
    for group, name in enumerate(_ESC_GROUPS):
        messages = log[f"ESC_TELEMETRY_{name}"]
        live = [i for i in range(4) if np.any(messages.numbers(f"rpm[{i}]") > 0.0)]
        streams += messages.stream({f"rpm{4 * group + i + 1}": (f"rpm[{i}]", 1.0) for i in live})
    if streams:
        return streams
    status, used = log["ESC_STATUS"], set[str]()
    bases = status.numbers("index").astype(int)
    for base in sorted({base for base in bases.tolist() if 0 <= base < 32}):
        escs = status.where(bases == base)
        live = [i for i in range(4) if np.any(escs.numbers(f"rpm[{i}]") != 0.0)]
        scales = {f"rpm{base + i + 1}": (f"rpm[{i}]", 1.0) for i in live}
        # Where groups overlap, the first has priority.
        streams += escs.stream({name: scale for name, scale in scales.items() if name not in used})
        used |= set(scales)
    return streams or log["RPM"].stream({"rpm1": ("rpm1", 1.0), "rpm2": ("rpm2", 1.0)})


UNKNOWN = {"voltage_battery": (65535.0, 0.0), "current_battery": (-1.0,)}  # no value


def _battery(messages: Messages) -> list[Stream]:
    """Return voltage and current, nan if unknown."""
    scales = {"voltage_V": ("voltage_battery", 1e-3), "current_A": ("current_battery", 1e-2)}
    bad = {name: np.isin(messages.numbers(name), UNKNOWN[name]) for name, _ in scales.values()}
    streams = messages.stream({k: scale for k, scale in scales.items() if not bad[scale[0]].all()})
    for stream in streams:
        for channel, name in stream.fields.items():
            stream.columns[channel][bad[name]] = np.nan
    return streams


def _distance(log: MessageLog) -> list[Stream]:
    messages = log["DISTANCE_SENSOR"]
    if not len(messages):
        return log["RANGEFINDER"].stream({"distance_m": ("distance", 1.0)})
    down = messages.select_downward("orientation", log.findings)
    return down.stream({"distance_m": ("current_distance", 0.01)})


_WRAP_US = 1 << 32  # time_usec of SERVO_OUTPUT_RAW has 32 bits


class AutopilotClock:
    """Conversion of host time stamps to the autopilot's clock.

    A log's stamps are times of reception by the host, and radio links deliver late and in bursts.
    Messages with the autopilot's time since boot keep it; for others it is interpolated between
    attitude messages by the host's stamps.
    """

    def __init__(self, host_us: Times, boot_ms: NDArray[np.float64]) -> None:
        """Build the clock from times (m,) of attitudes, at least one, in the order of reception."""
        device_us = (1000.0 * boot_ms).astype(np.int64)
        steps = np.diff(device_us, prepend=device_us[:1])
        # Late messages step back by less than a second; a reboot by all the time since the last.
        booted = np.flatnonzero(steps < -1_000_000)
        offsets = np.zeros(device_us.size, np.int64)
        for row in booted.tolist():
            waited = max(int(host_us[row] - host_us[row - 1]), 0)
            offsets[row:] = device_us[row - 1] + offsets[row - 1] + waited - device_us[row]
        self.host_us, self.boot_us = host_us, device_us + offsets  # continues over a reboot
        self.starts = tuple(booted.tolist())  # rows at which the autopilot rebooted
        self.offsets_us = offsets  # (m,) added to the autopilot's time since boot

    def time_from_host(self, host_us: Times) -> Times:
        """Return the time of messages without autopilot time."""
        order = np.argsort(self.host_us, kind="stable")
        host, boot = self.host_us[order], np.maximum.accumulate(self.boot_us[order])
        inside = np.interp(host_us.astype(float), host.astype(float), boot.astype(float))
        before, after = np.minimum(host_us - host[0], 0), np.maximum(host_us - host[-1], 0)
        times: Times = np.rint(inside).astype(np.int64) + before + after
        return times

    def time_from_wrapped_us(self, host_us: Times, count_us: NDArray[np.float64]) -> Times:
        """Return the clock times of messages stamped with the low 32 bits of us since boot: us."""
        near = self.time_from_host(host_us) - self.offset_us(host_us)
        ahead = (count_us.astype(np.int64) - near + _WRAP_US // 2) % _WRAP_US - _WRAP_US // 2
        times: Times = near + ahead + self.offset_us(host_us)
        return times

    def offset_us(self, host_us: Times) -> Times:
        """Return the difference of clock time and time since boot at host time stamps."""
        rows = np.searchsorted(np.maximum.accumulate(self.host_us), host_us, "right") - 1
        return self.offsets_us[np.clip(rows, 0, self.host_us.size - 1)]
