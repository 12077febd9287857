"""One point from its samples: means, and thrust through a calibration where there is one."""

from __future__ import annotations

from collections.abc import Mapping
from math import nan

import numpy as np

from benchtool.acquire.average import Average, average
from benchtool.acquire.calibration import Calibration
from benchtool.acquire.order import Visit
from benchtool.acquire.tare import Tared
from benchtool.core.recording import Recording
from benchtool.data.run.points import Point


def shortage(
    samples: Recording, rates_Hz: Mapping[str, float], seconds: float, share: float
) -> str:
    """Return which channel of a point lacks samples, in words; "" where none does.

    Args:
        rates_Hz: how often each channel that the point needs should bring a value.
    """
    for name, rate_Hz in rates_Hz.items():
        expected = seconds * rate_Hz
        count = int(np.isfinite(samples.column(name)).sum())
        # The span may begin just behind a value.
        if count < share * expected - 1.0 or not count:
            return (
                f"{count} of {expected:.0f} samples of {name} came, at least {100.0 * share:g} % "
                f"are needed (sample_share)"
            )
    return ""


def measure(
    samples: Recording,
    visit: Visit,
    reached_m: float,
    tared: Tared,
    calibration: Calibration | None,
    quantum_N: float,
    settled: bool,
    now_s: float = nan,
) -> Point:
    """Return the point that a visit's samples make.

    Args:
        reached_m: plate distance that the stage reported; used where the stream has none.
        now_s: time of the point where it has no samples.
    """
    place = visit.setting.place
    if calibration is None:
        thrust_N = samples.column("thrust_N")
    else:
        thrust_N = calibration.newtons(samples.column("thrust_raw"), tared.zero_counts)
    thrust = average(thrust_N, quantum_N)
    times_s = samples.column("time_s")
    time_s = float(times_s.mean()) if len(times_s) else now_s

    def average_of(name: str) -> Average:
        return average(samples.column(name)) if name in samples else Average(nan, nan, nan, 0)

    def mean_of(name: str, otherwise: float) -> float:
        found = average_of(name)
        return found.mean if found.n else otherwise

    speeds = [average_of(f"rpm{rotor + 1}") for rotor in range(len(visit.setting.pwm_us))]
    return Point(
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
        plate_read_z_m=mean_of("plate_z_m", nan),
        plate_x_m=mean_of("plate_x_m", place.x_m),
        plate_tilt_deg=mean_of("plate_tilt_deg", place.tilt_deg),
        voltage_V=mean_of("voltage_V", nan),
        current_A=mean_of("current_A", nan),
        torque_Nm=mean_of("torque_Nm", nan),
        temperature_degC=mean_of("temperature_degC", nan),
        settled=settled,
    )
