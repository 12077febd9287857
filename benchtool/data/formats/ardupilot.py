"""Pitch recordings from ArduPilot DataFlash logs, binary or text.

Binary format as in ArduPilot's LogStructure.h: each record is 0xA3 0x95, a type, and a body whose
layout is in an FMT record (type 128). It is read column by column with NumPy; numbers are equal to
those of pymavlink's DFReader.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.text import pluralize
from benchtool.data.formats.flight_log import (
    RAD,
    MessageLog,
    Messages,
    Scales,
    Stream,
    ardupilot_motors,
    import_flight_log,
    motor_outputs,
)
from benchtool.data.repairs.import_result import Finding, ImportResult, line_ranges

Positions = NDArray[np.intp]

HEAD = b"\xa3\x95"
FMT_TYPE, FMT_LENGTH = 0x80, 89

_TYPES = {letter: f"<{letter}" for letter in "bBhHiIfdqQ"}  # NumPy type by format letter
_TYPES |= zip("gMcCeEL", ("<e", "b", "<h", "<H", "<i", "<I", "<i"), strict=True)
_TYPES |= zip("anNZ", ("V64", "S4", "S16", "S64"), strict=True)
TIMES_US = {"TimeUS": 1, "TimeMS": 1000}  # microseconds per unit of a time column
_DIVISORS = {**dict.fromkeys("cCeE", 100.0), "L": 1e7}


@dataclass(frozen=True, slots=True)
class RecordLayout:
    """Layout from an FMT record: name, length with header, format letters, columns."""

    name: str
    length: int
    letters: str
    columns: tuple[str, ...]

    def messages(self, text: NDArray[np.uint8], starts: Positions) -> Messages | None:
        """Return the records at these positions (m,) as messages; None for a broken layout.

        Letters, columns and length of a broken layout are inconsistent. Of duplicate columns, the
        first is returned.
        """
        if set(self.letters) - set(_TYPES) or len(self.columns) != len(self.letters):
            return None
        body = np.dtype([(f"f{i}", _TYPES[letter]) for i, letter in enumerate(self.letters)])
        if body.itemsize != self.length - 3:
            return None
        bodies = np.zeros(0, body)
        if starts.size and body.itemsize:
            views = np.lib.stride_tricks.sliding_window_view(text, body.itemsize)
            bodies = np.ascontiguousarray(views[starts + 3]).view(body).reshape(-1)
        fields: dict[str, NDArray[Any]] = {}
        divisors: dict[str, float] = {}
        for i, (name, letter) in enumerate(zip(self.columns, self.letters, strict=True)):
            fields.setdefault(name, bodies[f"f{i}"])
            divisors.setdefault(name, _DIVISORS.get(letter, 1.0))
        return Messages(self.name, _times_us(fields), fields, divisors)


def _times_us(fields: Mapping[str, NDArray[Any]]) -> NDArray[np.int64] | None:
    """Return records' times (m,) in microseconds since boot, or None without a time column."""
    for name, scale in TIMES_US.items():
        if name in fields and fields[name].dtype.kind in "iuf":
            times: NDArray[np.int64] = fields[name].astype(np.int64) * scale
            return times
    return None


def read_dataflash(data: bytes, selected: frozenset[str]) -> MessageLog:
    """Return the selected kinds of records of a log, with findings for unused bytes."""
    text = np.frombuffer(data, np.uint8)
    heads = np.flatnonzero((text[:-2] == HEAD[0]) & (text[1:-1] == HEAD[1]))
    layouts = _layouts(data, heads[text[heads + 2] == FMT_TYPE])
    starts, ends = _chain(text, heads, layouts)
    confirmed = _layouts(data, starts[text[starts + 2] == FMT_TYPE])
    if confirmed != layouts:
        # An apparent FMT record was part of another record's body.
        layouts = confirmed
        starts, ends = _chain(text, heads, layouts)
    broken = int(starts.size > 0 and ends[-1] > text.size)
    findings = _account(text.size, starts, ends)
    if broken:
        starts = starts[:-1]
    total = int(starts.size)
    types = text[starts + 2]
    kinds: dict[str, Messages] = {}
    for number, layout in layouts.items():
        if layout.name not in selected:
            continue
        rows = starts[types == number]
        messages = layout.messages(text, rows)
        if messages is not None:
            kinds[layout.name] = messages
        elif rows.size:
            message = f"{pluralize(rows.size, 'record')} of {layout.name}: inconsistent FMT record"
            findings.append(Finding("refused", "broken format", message, layout.name, rows.size))
            broken += int(rows.size)
            total -= int(rows.size)
    return MessageLog(kinds=kinds, total=total, broken=broken, findings=findings)


def _layouts(data: bytes, starts: Positions) -> dict[int, RecordLayout]:
    layouts = {FMT_TYPE: RecordLayout("FMT", FMT_LENGTH, "BBnNZ", ())}
    for start in starts.tolist():
        if start + FMT_LENGTH > len(data):
            continue
        kind, length, name, letters, columns = struct.unpack_from("<BB4s16s64s", data, start + 3)
        texts = [raw.split(b"\0")[0].decode("latin-1") for raw in (name, letters, columns)]
        if length >= 3 and kind != FMT_TYPE:
            layouts[kind] = RecordLayout(texts[0], length, texts[1], tuple(texts[2].split(",")))
    return layouts


def _chain(
    text: NDArray[np.uint8], heads: Positions, layouts: dict[int, RecordLayout]
) -> tuple[Positions, Positions]:
    """Return the offsets at which records begin and end; records do not overlap.

    The two bytes of a record's head also occur by chance inside bodies (one in 65,000 positions);
    following the lengths skips them. The loop runs only over gaps between records.
    """
    lengths = np.zeros(256, np.intp)
    for kind, layout in layouts.items():
        lengths[kind] = layout.length
    heads = heads[lengths[text[heads + 2]] > 0]
    ends = heads + lengths[text[heads + 2]]
    successors = np.searchsorted(heads, ends)
    jumps = np.flatnonzero(successors != np.arange(heads.size) + 1)
    is_record = np.zeros(heads.size, bool)
    index = 0
    for jump in jumps.tolist():
        if jump < index:
            continue
        is_record[index : jump + 1] = True
        index = int(successors[jump])
    is_record[index:] = True
    return heads[is_record], ends[is_record]


def _account(size: int, starts: Positions, ends: Positions) -> list[Finding]:
    """Return findings for bytes outside records, and for a truncated last record."""
    begins = np.concatenate([starts, [size]])
    stops = np.minimum(np.concatenate([[0], ends]), size)
    gaps = begins - stops
    inside, findings = gaps[:-1], []
    n_gaps = int(np.count_nonzero(inside > 0))
    if n_gaps:
        lost, first = int(inside.sum()), int(stops[np.flatnonzero(inside > 0)[0]])
        message = (
            f"{lost:,} bytes in {pluralize(n_gaps, 'place')} belong to no record, first at byte "
            f"{first:,}; skipped to the next record"
        )
        findings.append(Finding("refused", "corrupt bytes", message, count=0))
    if starts.size and ends[-1] > size:
        length = int(ends[-1] - starts[-1])
        message = (
            f"the log ends at byte {size:,} in the middle of a record of {length} bytes that "
            f"begins at byte {int(starts[-1]):,}"
        )
        findings.append(Finding("refused", "cut off", message, count=1))
    elif gaps[-1] > 0:
        remaining = pluralize(int(gaps[-1]), "byte")
        message = f"the last record ends at byte {int(stops[-1]):,}, {remaining} before the end"
        findings.append(Finding("refused", "corrupt bytes", message, count=0))
    return findings


def read_text_log(data: bytes, selected: frozenset[str]) -> MessageLog:
    """Return the selected kinds of records of a log in text form, one record per line."""
    columns: dict[str, tuple[str, ...]] = {}
    rows: dict[str, list[list[bytes]]] = {name: [] for name in selected}
    bad: list[int] = []
    total = 0
    for number, line in enumerate(data.split(b"\n"), 1):
        start, comma, body = line.partition(b",")
        kind = start.strip().decode("latin-1") if comma else ""
        cells = body.rstrip(b"\r").split(b",")
        if kind == "FMT" and len(cells) >= 4:
            name, *names = (cell.strip().decode("latin-1") for cell in (cells[2], *cells[4:]))
            columns.setdefault(name, tuple(names))
        elif kind in selected:
            layout = columns.get(kind, ())
            if not layout or len(cells) < len(layout) or not _has_time(layout, cells):
                bad.append(number)
                continue
            # The last column may contain commas.
            cells[len(layout) - 1 :] = [b",".join(cells[len(layout) - 1 :])]
            rows[kind].append([cell.strip() for cell in cells])
        elif kind == "FMT" or kind not in columns:
            bad += [number] if line.strip() else []
            continue
        total += 1
    findings = []
    if bad:
        message = f"{pluralize(len(bad), 'line')} without a complete record"
        lines = line_ranges(bad)
        findings.append(Finding("refused", "broken lines", message, count=len(bad), lines=lines))
    kinds = {}
    for name, texts in rows.items():
        if texts:
            fields: dict[str, NDArray[Any]] = {}
            for column, values in zip(columns[name], zip(*texts, strict=True), strict=True):
                fields.setdefault(column, np.array(values))
            for time in TIMES_US.keys() & fields:
                fields[time] = fields[time].astype(np.int64)
            kinds[name] = Messages(name, _times_us(fields), fields)
    return MessageLog(kinds=kinds, total=total, broken=len(bad), findings=findings)


def _has_time(columns: tuple[str, ...], row: list[bytes]) -> bool:
    """Return whether a record's time is a whole number of at most 15 digits."""
    for name in TIMES_US:
        if name in columns:
            cell = row[columns.index(name)].strip()
            return cell.isdigit() and len(cell) < 16
    return True


WANTED = frozenset(  # messages that are read; others are only counted
    {
        *("ATT", "ANG", "RATE", "IMU", "RCOU", "ESC", "RPM", "BAT", "CURR", "RFND", "PARM", "MSG"),
        *(f"ESC{number}" for number in range(1, 9)),
    }
)

GOOD_RANGE = 4  # RangeFinder::Status::Good of ArduPilot's AP_RangeFinder.h


def read_binary(data: bytes, where: str) -> ImportResult:
    """Return a DataFlash log (.bin) as a pitch recording."""
    return _read(read_dataflash(data, WANTED), where)


def read_text(data: bytes, where: str) -> ImportResult:
    """Return a DataFlash log in its text form (.log) as a pitch recording."""
    return _read(read_text_log(data, WANTED), where)


def _read(log: MessageLog, where: str) -> ImportResult:
    motors = ardupilot_motors(log["PARM"], "Name", "Value")
    battery = _first(log["BAT"] if len(log["BAT"]) else log["CURR"])
    streams = [
        *_attitude(log),
        *_rates(log),
        *_outputs(log, motors),
        *_speeds(log, motors),
        *battery.stream({"voltage_V": ("Volt", 1.0), "current_A": ("Curr", 1.0)}),
        *_distance(log),
    ]
    texts = log["MSG"].texts("Message") if log["MSG"].has("Message") else []
    firmware = next((text for text in texts if text.startswith(("Ardu", "APM"))), "ArduPilot")
    return import_flight_log(log, streams, where, firmware)


def _first(messages: Messages) -> Messages:
    """Return the messages of the first instance, or all if there are no instances."""
    for field in ("I", "Instance", "Inst"):
        if messages.has(field):
            return messages.where(messages.numbers(field) == 0.0)
    return messages


def _attitude(log: MessageLog) -> list[Stream]:
    """Return the attitude, from ANG if it has more messages: 4.6 logs it fast, and ATT at 10 Hz.

    ATT messages before and after ANG are then dropped, with a finding.
    """
    scales: Scales = {
        "theta_rad": ("Pitch", -RAD),
        "theta_ref_rad": ("DesPitch", -RAD),
        "roll_rad": ("Roll", RAD),
        "roll_ref_rad": ("DesRoll", RAD),
        "yaw_rad": ("Yaw", RAD),
        "yaw_ref_rad": ("DesYaw", RAD),
    }
    slow, fast = log["ATT"].stream(scales), log["ANG"].stream(scales)
    if not fast or (slow and slow[0].time_us.size >= fast[0].time_us.size):
        return slow
    text = f"ANG, {pluralize(fast[0].time_us.size, 'message')}"
    if slow:
        slow_us, fast_us = slow[0].time_us, fast[0].time_us
        n_outside = int(np.count_nonzero((slow_us < fast_us.min()) | (slow_us > fast_us.max())))
        text += f", in place of ATT, {slow_us.size}, {n_outside} of them before or after it"
    log.findings.append(Finding("read as", "attitude", text, "theta_rad", fast[0].time_us.size))
    return fast


def _rates(log: MessageLog) -> list[Stream]:
    """Return gyro rates, rate setpoints and outputs of the rate controller (-1 to 1).

    Without IMU messages the gyro rates are the inputs of the rate controller.
    """
    gyro = {
        "gyro_rad_s": ("GyrY", -1.0),
        "roll_rate_rad_s": ("GyrX", 1.0),
        "yaw_rate_rad_s": ("GyrZ", 1.0),
    }
    rate = {"gyro_rad_s": ("P", -RAD), "roll_rate_rad_s": ("R", RAD), "yaw_rate_rad_s": ("Y", RAD)}
    setpoints: Scales = {
        "gyro_ref_rad_s": ("PDes", -RAD),
        "roll_rate_ref_rad_s": ("RDes", RAD),
        "yaw_rate_ref_rad_s": ("YDes", RAD),
        "pitch_command_share": ("POut", -1.0),
        "roll_command_share": ("ROut", 1.0),
        "yaw_command_share": ("YOut", 1.0),
        "throttle_command_share": ("AOut", 1.0),
    }
    imu = _first(log["IMU"]).stream(gyro)
    return [*imu, *log["RATE"].stream(setpoints if imu else {**setpoints, **rate})]


def _outputs(log: MessageLog, motors: dict[int, int]) -> list[Stream]:
    pulses = log["RCOU"]
    fields = {n: f"C{n}" for n in range(1, 15) if pulses.has(f"C{n}")}
    fields = {n: field for n, field in fields.items() if np.any(pulses.numbers(field) > 0.0)}
    if not fields:
        return []
    return motor_outputs(pulses, fields, motors, "SERVOn_FUNCTION", log.findings)


def _speeds(log: MessageLog, motors: dict[int, int]) -> list[Stream]:
    if log["ESC"].has("Instance", "RPM"):
        instance = log["ESC"].numbers("Instance")
        streams, used = [], []
        valid = instance[(instance >= 0.0) & (instance < 32.0)]
        for number in sorted(set(valid.astype(int).tolist())):
            motor = motors.get(number + 1, number + 1)
            if motor in used or not 1 <= motor <= 32:
                continue
            used.append(motor)
            messages = log["ESC"].where(instance == number)
            streams += messages.stream({f"rpm{motor}": ("RPM", 1.0)})
        text = f"ESC instances count output channels from 0: rotors {', '.join(map(str, used))}"
        log.findings.append(Finding("read as", "rpm", text))
        return streams
    escs = [n for n in range(1, 9) if log[f"ESC{n}"].has("RPM")]
    if escs:
        return [
            stream
            for n in escs
            for stream in log[f"ESC{n}"].stream({f"rpm{motors.get(n, n)}": ("RPM", 1.0)})
        ]
    if log["RPM"].has("RPM"):
        return _tachometers(log["RPM"], log.findings)
    return log["RPM"].stream({"rpm1": ("rpm1", 1.0), "rpm2": ("rpm2", 1.0)})


def _tachometers(messages: Messages, findings: list[Finding]) -> list[Stream]:
    """Return the speeds of RPM {I, RPM, Qual, H}: one message per sensor, with its health."""
    sensors = messages.numbers("I") if messages.has("I") else np.zeros(len(messages))
    streams = []
    for number in sorted(set(sensors.astype(int).tolist())):
        readings, name = messages.where(sensors == number), f"rpm{number + 1}"
        for stream in readings.stream({name: ("RPM", 1.0)}):
            if readings.has("H"):
                is_bad = readings.numbers("H") == 0.0
                stream.blank(name, is_bad, "the sensor reports as unhealthy", findings)
            streams.append(stream)
    text = "RPM sensors are numbered from 1; the log does not assign them to rotors"
    findings.append(Finding("read as", "rpm", text))
    return streams


def _distance(log: MessageLog) -> list[Stream]:
    field, orient = ("Dist", "Orient") if log["RFND"].has("Dist") else ("Dist1", "Orient1")
    rfnd = log["RFND"]
    if rfnd.has(field, orient):
        rfnd = rfnd.select_downward(orient, log.findings)
    for instance in ("Instance", "I"):
        if rfnd.has(field, instance):
            rfnd = rfnd.where(rfnd.numbers(instance) == np.min(rfnd.numbers(instance)))
    streams = rfnd.stream({"distance_m": (field, 1.0)})
    if streams and rfnd.has("Stat"):
        is_bad = rfnd.numbers("Stat") != GOOD_RANGE
        reason = "the sensor reports as out of range"
        streams[0].blank("distance_m", is_bad, reason, log.findings)
    return streams
