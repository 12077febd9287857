"""One point from its samples: robust means, thrust through a calibration where there is one."""

from __future__ import annotations

from collections.abc import Mapping
from math import nan

import numpy as np

from benchtool.acquire.average import Average, average, estimate_quantum
from benchtool.acquire.tare import TareResult
from benchtool.acquire.visit_order import Visit
from benchtool.core.array_type import Array
from benchtool.core.recording import Recording
from benchtool.core.rig import Sensor
from benchtool.data.calibration import Calibration
from benchtool.data.run.points import Point, averaged_channels

MAX_BEAT_PERIOD = 1.0  # least cycles of a vibration in a point, to tell it from thrust; assumed


def is_aliased(rpm: float, time_s: Array) -> str:
    """Return that a rotor's vibration reads as thrust in samples at these times, "" where not.

    A vibration at the shaft's frequency that lies at a multiple of the sampling rate is the same in
    every sample: their scatter does not show it, and their mean is off by up to its amplitude.
    """
    span_s = float(time_s[-1] - time_s[0]) if len(time_s) > 1 else 0.0
    if not (span_s > 0.0 and rpm > 0.0):
        return ""
    rate_Hz, turns_Hz = (len(time_s) - 1) / span_s, rpm / 60.0
    multiple = round(turns_Hz / rate_Hz)
    if not multiple or abs(turns_Hz - multiple * rate_Hz) * span_s >= MAX_BEAT_PERIOD:
        return ""
    times = "" if multiple == 1 else f"{multiple} times "
    return (
        f"turned at {turns_Hz:.1f} Hz, {times}the {rate_Hz:.1f} Hz of the load cell's samples: its "
        f"vibration reads as thrust there; measure at a pulse beside this one"
    )


def measure(
    samples: Recording,
    visit: Visit,
    reached_m: float,
    tared: TareResult,
    calibration: Calibration | None,
    sensors: Mapping[str, Sensor],
    settled: bool,
    now_s: float = nan,
) -> tuple[Point, list[tuple[str, str]]]:
    """Return the point that a visit's samples make, and events about it by kind and text.

    Args:
        reached_m: plate distance that the stage reported; used where the stream has none.
        now_s: time of the point where it has no samples.
    """
    place = visit.setting.place
    n_rotors = len(visit.setting.pwm_us)
    names = [name for name in averaged_channels(n_rotors) if name in samples]
    columns = {name: samples.column(name) for name in names}
    if calibration is not None:
        columns["thrust_N"] = calibration.newtons(samples.column("thrust_raw"), tared.zero_counts)
    found = {
        name: average(column, estimate_quantum(name, sensors)) for name, column in columns.items()
    }
    times_s = samples.column("time_s")
    time_s = float(times_s.mean()) if len(times_s) else now_s
    none = Average(nan, nan, nan, 0)

    def mean_of(name: str, otherwise: float = nan) -> float:
        own = found.get(name, none)
        return own.mean if own.n else otherwise

    thrust = found["thrust_N"]
    speeds = [found.get(f"rpm{rotor + 1}", none) for rotor in range(n_rotors)]
    thrust_s = times_s[np.isfinite(columns["thrust_N"])]
    shakes = [
        f"rotor {number} {text}"
        for number, speed in enumerate(speeds, 1)
        if (text := is_aliased(speed.mean, thrust_s))
    ]
    notes = [("suspect", f"point {visit.point}: {text}") for text in shakes]
    for name, own in found.items():
        if text := own.rejection(name):
            kind = "suspect" if own.suspect else "outliers"
            notes.append((kind, f"point {visit.point}: {text}"))
    point = Point(
        point=visit.point,
        kind=visit.kind,
        setting=visit.setting.number,
        repeat=visit.repeat,
        time_s=time_s,
        elapsed_s=time_s - tared.time_s,
        pwm_us=visit.setting.pwm_us,
        rpm=tuple(speed.mean for speed in speeds),
        rpm_se=tuple(speed.se for speed in speeds),
        thrust_N=thrust.mean,
        thrust_sd_N=thrust.sd,
        thrust_se_N=thrust.se,
        n_samples=thrust.n,
        plate_z_m=mean_of("plate_z_m", reached_m),
        plate_stage_z_m=reached_m,
        plate_read_z_m=mean_of("plate_z_m"),
        plate_x_m=mean_of("plate_x_m", place.x_m),
        plate_tilt_deg=mean_of("plate_tilt_deg", place.tilt_deg),
        voltage_V=mean_of("voltage_V"),
        current_A=mean_of("current_A"),
        torque_Nm=mean_of("torque_Nm"),
        temperature_degC=mean_of("temperature_degC"),
        settled=settled,
        rejected={name: own.n_rejected for name, own in found.items()},
        suspect=any(kind == "suspect" for kind, _ in notes),
        voltage_se_V=found.get("voltage_V", none).se,
        current_se_A=found.get("current_A", none).se,
        torque_se_Nm=found.get("torque_Nm", none).se,
    )
    return point, notes
