"""Take from an ArduPilot log what a pitch recording needs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array import Array
from benchtool.core.counted import counted
from benchtool.data.formats.dataflash import read_dataflash
from benchtool.data.formats.dataflash_text import read_text_log
from benchtool.data.formats.flight_log import (
    Counts,
    Scales,
    Stream,
    blank_bad,
    flight_import,
    looking_down,
    stream_of,
)
from benchtool.data.formats.motor_channels import ardupilot_motors, logged_motors
from benchtool.data.repairs.imported import Finding, Imported, Options

WANTED = frozenset(
    {
        *("ATT", "ANG", "RATE", "IMU", "RCOU", "ESC", "RPM", "BAT", "CURR", "RFND", "PARM", "MSG"),
        *(f"ESC{number}" for number in range(1, 9)),
    }
)
"""Messages of a log that are read; the others are counted only."""

GOOD_RANGE = 4
"""RangeFinder::Status::Good of ArduPilot's AP_RangeFinder.h."""

_DEG = np.pi / 180.0


class Records(Protocol):
    """A log's records by name; what `DataFlashLog` and `TextLog` have in common."""

    @property
    def total(self) -> int: ...
    @property
    def broken(self) -> int: ...
    @property
    def findings(self) -> tuple[Finding, ...]: ...
    def count(self, name: str) -> int:
        """Return how many records of a kind there are."""

    def has(self, name: str, field: str) -> bool:
        """Tell whether records of a kind stand in the log and have a field."""

    def numbers(self, name: str, field: str) -> Array:
        """Return one field of all records of a kind (m,)."""

    def times_us(self, name: str) -> NDArray[np.int64]:
        """Return the records' times (m,) in microseconds since boot."""

    def texts(self, name: str, field: str) -> list[str]:
        """Return one field of all records of a kind as text."""


def read_binary(
    data: bytes, where: str, provenance: Mapping[str, str], options: Options
) -> Imported:
    """Return a DataFlash log (.bin) as a pitch recording."""
    return _read(read_dataflash(data, WANTED), "ArduPilot DataFlash", where, provenance)


def read_text(data: bytes, where: str, provenance: Mapping[str, str], options: Options) -> Imported:
    """Return a DataFlash log in its text form (.log) as a pitch recording."""
    return _read(read_text_log(data, WANTED), "ArduPilot DataFlash text", where, provenance)


def _read(log: Records, name: str, where: str, provenance: Mapping[str, str]) -> Imported:
    findings = list(log.findings)
    motors = _motors(log)
    streams = [
        *_attitude(log, findings),
        *_rates(log),
        *_outputs(log, motors, findings),
        *_speeds(log, motors, findings),
        *_battery(log),
        *_distance(log, findings),
    ]
    counts = Counts(total=log.total, broken=log.broken)
    facts = {**provenance, "device": _firmware(log)}
    return flight_import(streams, name, where, facts, findings, counts)


def _stream(
    log: Records, name: str, scales: Scales, rows: NDArray[np.bool_] | None = None
) -> list[Stream]:
    """Return one kind of record as a stream of those fields that it has; none without a time."""
    if not (log.has(name, "TimeUS") or log.has(name, "TimeMS")):
        return []
    chosen = slice(None) if rows is None else rows

    def numbers(field: str) -> Array | None:
        return log.numbers(name, field)[chosen] if log.has(name, field) else None

    return stream_of(name, log.times_us(name)[chosen], scales, numbers)


def _first(log: Records, name: str) -> NDArray[np.bool_] | None:
    """Return which records are of the first instance; None where there are no instances."""
    for field in ("I", "Instance", "Inst"):
        if log.has(name, field):
            return np.asarray(log.numbers(name, field) == 0.0)
    return None


def _attitude(log: Records, findings: list[Finding]) -> list[Stream]:
    """Return the attitude, of ANG where it is denser: 4.6 logs it fast, and ATT at 10 Hz.

    What ATT tells before and after the other is left out, and said.
    """
    scales: Scales = {
        "theta_rad": ("Pitch", -_DEG),
        "theta_ref_rad": ("DesPitch", -_DEG),
        "roll_rad": ("Roll", _DEG),
        "roll_ref_rad": ("DesRoll", _DEG),
        "yaw_rad": ("Yaw", _DEG),
        "yaw_ref_rad": ("DesYaw", _DEG),
    }
    slow, fast = _stream(log, "ATT", scales), _stream(log, "ANG", scales)
    if not fast or (slow and slow[0].time_us.size >= fast[0].time_us.size):
        return slow
    words = f"ANG, {counted(fast[0].time_us.size, 'message')}"
    if slow:
        times, own = slow[0].time_us, fast[0].time_us
        beyond = int(np.count_nonzero((times < own.min()) | (times > own.max())))
        words += f", in place of ATT, {times.size}, {beyond} of them before or after it"
    findings.append(Finding("read as", "attitude", words, "theta_rad", fast[0].time_us.size))
    return fast


def _rates(log: Records) -> list[Stream]:
    """Return the gyro, wanted rates and what the rate controller commands (-1 to 1).

    Where no IMU is logged, the gyro is what the rate controller saw.
    """
    gyro = {
        "gyro_rad_s": ("GyrY", -1.0),
        "roll_rate_rad_s": ("GyrX", 1.0),
        "yaw_rate_rad_s": ("GyrZ", 1.0),
    }
    seen = {
        "gyro_rad_s": ("P", -_DEG),
        "roll_rate_rad_s": ("R", _DEG),
        "yaw_rate_rad_s": ("Y", _DEG),
    }
    wanted: Scales = {
        "gyro_ref_rad_s": ("PDes", -_DEG),
        "roll_rate_ref_rad_s": ("RDes", _DEG),
        "yaw_rate_ref_rad_s": ("YDes", _DEG),
        "pitch_command_share": ("POut", -1.0),
        "roll_command_share": ("ROut", 1.0),
        "yaw_command_share": ("YOut", 1.0),
        "throttle_command_share": ("AOut", 1.0),
    }
    imu = _stream(log, "IMU", gyro, _first(log, "IMU"))
    return [*imu, *_stream(log, "RATE", wanted if imu else {**wanted, **seen})]


def _motors(log: Records) -> dict[int, int]:
    if not (log.has("PARM", "Name") and log.has("PARM", "Value")):
        return {}
    names, values = log.texts("PARM", "Name"), log.numbers("PARM", "Value")
    return ardupilot_motors(dict(zip(names, values.tolist(), strict=True)))


def _outputs(log: Records, motors: dict[int, int], findings: list[Finding]) -> list[Stream]:
    channels = [
        n
        for n in range(1, 15)
        if log.has("RCOU", f"C{n}") and np.any(log.numbers("RCOU", f"C{n}") > 0.0)
    ]
    if not channels:
        return []
    chosen = logged_motors(motors, channels, "SERVOn_FUNCTION", findings)
    return _stream(log, "RCOU", {f"pwm{motor}_us": (f"C{n}", 1.0) for n, motor in chosen.items()})


def _speeds(log: Records, motors: dict[int, int], findings: list[Finding]) -> list[Stream]:
    if log.has("ESC", "Instance") and log.has("ESC", "RPM"):
        instance = log.numbers("ESC", "Instance")
        streams, taken = [], []
        for number in sorted(set(instance[np.isfinite(instance)].astype(int).tolist())):
            motor = motors.get(number + 1, number + 1)
            if motor in taken or not 1 <= motor <= 32:
                continue
            taken.append(motor)
            streams += _stream(log, "ESC", {f"rpm{motor}": ("RPM", 1.0)}, instance == number)
        words = f"ESC instances count output channels from 0: rotors {', '.join(map(str, taken))}"
        findings.append(Finding("read as", "rpm", words))
        return streams
    own = [n for n in range(1, 9) if log.has(f"ESC{n}", "RPM")]
    if own:
        return [
            stream
            for n in own
            for stream in _stream(log, f"ESC{n}", {f"rpm{motors.get(n, n)}": ("RPM", 1.0)})
        ]
    if log.has("RPM", "RPM"):
        return _tachometers(log, findings)
    return _stream(log, "RPM", {"rpm1": ("rpm1", 1.0), "rpm2": ("rpm2", 1.0)})


def _tachometers(log: Records, findings: list[Finding]) -> list[Stream]:
    """Return the speeds of RPM {I, RPM, Qual, H}: one message for each sensor, with its health."""
    sensors = log.numbers("RPM", "I") if log.has("RPM", "I") else np.zeros(log.count("RPM"))
    streams = []
    for number in sorted(set(sensors.astype(int).tolist())):
        rows, name = sensors == number, f"rpm{number + 1}"
        (stream,) = _stream(log, "RPM", {name: ("RPM", 1.0)}, rows)
        if log.has("RPM", "H"):
            ill = log.numbers("RPM", "H")[rows] == 0.0
            blank_bad(stream, name, ill, "the sensor calls unhealthy", findings)
        streams.append(stream)
    words = "RPM sensors carry their own numbers, from 1; the log does not say which rotor they see"
    findings.append(Finding("read as", "rpm", words))
    return streams


def _battery(log: Records) -> list[Stream]:
    name = "BAT" if log.count("BAT") else "CURR"
    scales = {"voltage_V": ("Volt", 1.0), "current_A": ("Curr", 1.0)}
    return _stream(log, name, scales, _first(log, name))


def _distance(log: Records, findings: list[Finding]) -> list[Stream]:
    field, orient = ("Dist", "Orient") if log.has("RFND", "Dist") else ("Dist1", "Orient1")
    if not log.has("RFND", field):
        return []
    rows: NDArray[np.bool_] | None = np.ones(log.count("RFND"), bool)
    if log.has("RFND", orient):
        rows = looking_down(log.numbers("RFND", orient), findings)
    if rows is None:
        return []
    for instance in ("Instance", "I"):
        if log.has("RFND", instance):
            numbers = log.numbers("RFND", instance)
            rows &= numbers == np.min(numbers[rows])
    streams = _stream(log, "RFND", {"distance_m": (field, 1.0)}, rows)
    if streams and log.has("RFND", "Stat"):
        bad = log.numbers("RFND", "Stat")[rows] != GOOD_RANGE
        blank_bad(streams[0], "distance_m", bad, "the sensor itself calls out of range", findings)
    return streams


def _firmware(log: Records) -> str:
    if not log.has("MSG", "Message"):
        return "ArduPilot"
    texts = [text for text in log.texts("MSG", "Message") if text.startswith(("Ardu", "APM"))]
    return texts[0] if texts else "ArduPilot"
