"""Measured point from its samples: robust means and calibrated thrust."""

from __future__ import annotations

from collections.abc import Mapping
from math import nan

import numpy as np

from benchtool.acquire.average import Average, average, estimate_quantum
from benchtool.acquire.motors import TareResult
from benchtool.acquire.visit_order import Visit
from benchtool.core.recording import Recording
from benchtool.core.rig import Sensor
from benchtool.core.units import Array
from benchtool.data.run.points import Point, averaged_channels

MIN_BEAT_CYCLES = 1.0  # of a vibration within a point, to separate it from thrust; assumed


def is_aliased(rpm: float, time_s: Array) -> str:
    """Return a warning if a rotor's vibration is aliased to zero frequency, else "".

    A vibration at a multiple of the sampling rate is the same in every sample: it is not visible in
    the scatter and changes the mean by up to its amplitude.
    """
    span_s = float(time_s[-1] - time_s[0]) if len(time_s) > 1 else 0.0
    if not (span_s > 0.0 and rpm > 0.0):
        return ""
    rate_Hz, rotor_Hz = (len(time_s) - 1) / span_s, rpm / 60.0
    multiple = round(rotor_Hz / rate_Hz)
    if not multiple or abs(rotor_Hz - multiple * rate_Hz) * span_s >= MIN_BEAT_CYCLES:
        return ""
    times = "" if multiple == 1 else f"{multiple} times "
    return (
        f"turned at {rotor_Hz:.1f} Hz, {times}the load cell's sampling rate of {rate_Hz:.1f} Hz: "
        f"its vibration is aliased to a thrust offset; use a slightly different pulse"
    )


def measure(
    samples: Recording,
    visit: Visit,
    plate_stage_z_m: float,
    tare: TareResult,
    sensors: Mapping[str, Sensor],
    is_settled: bool,
) -> tuple[Point, list[tuple[str, str]]]:
    """Return the point of a visit's samples, and its events by kind and text.

    Args:
        plate_stage_z_m: plate distance reported by the stage; used if the stream has none.
    """
    n_rotors = len(visit.pwm_us)
    names = [name for name in averaged_channels(n_rotors) if name in samples]
    columns = {name: samples.column(name) for name in names}
    if tare.calibration is not None:
        raw = samples.column("thrust_raw")
        columns["thrust_N"] = tare.calibration.newtons(raw, tare.zero_counts)
    means = {
        name: average(column, estimate_quantum(name, sensors)) for name, column in columns.items()
    }
    times_s = samples.column("time_s")
    time_s = float(times_s.mean()) if len(times_s) else nan
    none = Average(nan, nan, nan, 0)

    def mean(name: str, default: float = nan) -> float:
        channel = means.get(name, none)
        return channel.mean if channel.n else default

    thrust = means["thrust_N"]
    speeds = [means.get(f"rpm{rotor + 1}", none) for rotor in range(n_rotors)]
    thrust_s = times_s[np.isfinite(columns["thrust_N"])]
    aliased = [
        f"rotor {number} {text}"
        for number, speed in enumerate(speeds, 1)
        if (text := is_aliased(speed.mean, thrust_s))
    ]
    notes = [("suspect", f"point {visit.point}: {text}") for text in aliased]
    for name, channel in means.items():
        if text := channel.rejection(name):
            kind = "suspect" if channel.suspect else "outliers"
            notes.append((kind, f"point {visit.point}: {text}"))
    point = Point(
        point=visit.point,
        kind=visit.kind,
        setting=visit.setting,
        repeat=visit.repeat,
        time_s=time_s,
        elapsed_s=time_s - tare.time_s,
        pwm_us=visit.pwm_us,
        rpm=tuple(speed.mean for speed in speeds),
        rpm_se=tuple(speed.se for speed in speeds),
        thrust_N=thrust.mean,
        thrust_sd_N=thrust.sd,
        thrust_se_N=thrust.se,
        n_samples=thrust.n,
        plate_z_m=mean("plate_z_m", plate_stage_z_m),
        plate_stage_z_m=plate_stage_z_m,
        plate_read_z_m=mean("plate_z_m"),
        plate_x_m=mean("plate_x_m", visit.target_x_m),
        plate_tilt_deg=mean("plate_tilt_deg", visit.target_tilt_deg),
        voltage_V=mean("voltage_V"),
        current_A=mean("current_A"),
        torque_Nm=mean("torque_Nm"),
        temperature_degC=mean("temperature_degC"),
        settled=is_settled,
        rejected={name: channel.n_rejected for name, channel in means.items()},
        suspect=any(kind == "suspect" for kind, _ in notes),
        voltage_se_V=means.get("voltage_V", none).se,
        current_se_A=means.get("current_A", none).se,
        torque_se_Nm=means.get("torque_Nm", none).se,
    )
    return point, notes
