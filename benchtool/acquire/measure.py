"""One point from its samples: robust means, thrust through a calibration where there is one."""

from __future__ import annotations

from collections.abc import Mapping
from math import nan

from benchtool.acquire.average import Average, average, quantum_of
from benchtool.acquire.order import Visit
from benchtool.acquire.tare import Tared
from benchtool.core.recording import Recording
from benchtool.core.rig import Sensor
from benchtool.data.calibration import Calibration
from benchtool.data.run.points import Point, averaged_channels


def measure(
    samples: Recording,
    visit: Visit,
    reached_m: float,
    tared: Tared,
    calibration: Calibration | None,
    sensors: Mapping[str, Sensor],
    settled: bool,
    now_s: float = nan,
) -> tuple[Point, dict[str, Average]]:
    """Return the point that a visit's samples make, and the average of every channel in it.

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
    found = {name: average(column, quantum_of(name, sensors)) for name, column in columns.items()}
    times_s = samples.column("time_s")
    time_s = float(times_s.mean()) if len(times_s) else now_s
    none = Average(nan, nan, nan, 0)

    def mean_of(name: str, otherwise: float = nan) -> float:
        own = found.get(name, none)
        return own.mean if own.n else otherwise

    thrust = found["thrust_N"]
    speeds = [found.get(f"rpm{rotor + 1}", none) for rotor in range(n_rotors)]
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
        suspect=any(own.suspect for own in found.values()),
        voltage_se_V=found.get("voltage_V", none).se,
        current_se_A=found.get("current_A", none).se,
        torque_se_Nm=found.get("torque_Nm", none).se,
    )
    return point, found
