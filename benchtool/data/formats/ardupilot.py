"""Pitch recordings from ArduPilot DataFlash logs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchtool.core.text import pluralize
from benchtool.data.formats.dataflash import read_dataflash, read_text_log
from benchtool.data.formats.flight_log import (
    RAD,
    MessageLog,
    Messages,
    Scales,
    Stream,
    ardupilot_motors,
    import_flight_log,
    select_motor_channels,
)
from benchtool.data.repairs.import_result import Finding, ImportOptions, ImportResult

WANTED = frozenset(  # messages that are read; others are only counted
    {
        *("ATT", "ANG", "RATE", "IMU", "RCOU", "ESC", "RPM", "BAT", "CURR", "RFND", "PARM", "MSG"),
        *(f"ESC{number}" for number in range(1, 9)),
    }
)

GOOD_RANGE = 4  # RangeFinder::Status::Good of ArduPilot's AP_RangeFinder.h


def read_binary(
    data: bytes, where: str, provenance: Mapping[str, str], options: ImportOptions
) -> ImportResult:
    """Return a DataFlash log (.bin) as a pitch recording."""
    return _read(read_dataflash(data, WANTED), "ArduPilot DataFlash", where, provenance)


def read_text(
    data: bytes, where: str, provenance: Mapping[str, str], options: ImportOptions
) -> ImportResult:
    """Return a DataFlash log in its text form (.log) as a pitch recording."""
    return _read(read_text_log(data, WANTED), "ArduPilot DataFlash text", where, provenance)


def _read(log: MessageLog, name: str, where: str, provenance: Mapping[str, str]) -> ImportResult:
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
    return import_flight_log(log, streams, name, where, {**provenance, "device": firmware})


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
    channels = [
        n for n in range(1, 15) if pulses.has(f"C{n}") and np.any(pulses.numbers(f"C{n}") > 0.0)
    ]
    if not channels:
        return []
    chosen = select_motor_channels(motors, channels, "SERVOn_FUNCTION", log.findings)
    return pulses.stream({f"pwm{motor}_us": (f"C{n}", 1.0) for n, motor in chosen.items()})


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
