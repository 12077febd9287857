"""Pitch or flight recording on an even clock, for figures and replay."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.recording import Recording
from benchtool.core.schedule import PARKED_M
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.explain.pitch.resampling import Resampler
from benchtool.simulate.pitch.filter_log import MIN_PARKED_Z_M

# Range of the clock's rate: slower logs are interpolated, faster ones decimated. Loops of pitch
# benches run at 250 Hz and more; assumed.
MIN_RATE_HZ, MAX_RATE_HZ = 50.0, 500.0

UNDER_FIRST = (
    "The log contains neither the covered rotor nor the slide of the plate; assumed: rotor 1, "
    "immediate coverage when plate_z_m is near."
)

LOW_RATE_HZ = 20.0  # slower outputs do not resolve a rate loop; assumed

_ROTOR = re.compile(r"pwm(\d+)_us|motor(\d+)_share|rpm(\d+)")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PitchTrack:
    """Recording on an even clock; nan where nothing was logged."""

    rate_Hz: float  # of the clock
    time_s: Array  # (n,) time of the recording
    theta_rad: Array  # (n,) positive nose down, also the two below
    gyro_rad_s: Array
    reference_rad: Array
    pwm_us: Array  # (n_rotors, n) pulses, held until the next; empty if none
    rpm: Array  # (n_rotors, n) speeds; empty if none
    torque_Nm: Array  # (n,) command of a controller
    disturbance_Nm: Array  # (n,) estimate of a controller
    plate_z_m: Array  # (n,) plate distance with a level beam; `PARKED_M` if parked
    distance_m: Array  # (n,) from a downward range sensor
    over: Array  # (n_rotors, n) coverage of each rotor by a surface, 0 to 1
    remarks: tuple[str, ...] = ()  # for the reader, on resampling

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def max_coverage(self) -> Array:
        """Largest coverage of a rotor by a surface (n,)."""
        share: Array = self.over.max(axis=0) if len(self.over) else np.zeros(len(self))
        return share

    @property
    def visits(self) -> list[tuple[int, int]]:
        """First and last row of each interval with a rotor over a surface."""
        inside = self.max_coverage > 0.0
        edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(np.int8), [0]])))
        return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]

    def rotors_over(self, first: int, last: int) -> list[int]:
        """Return the numbers of the rotors that are over a surface in these rows."""
        return [k + 1 for k, share in enumerate(self.over) if (share[first : last + 1] > 0.0).any()]


def pitch_track(recording: Recording, motors: Sequence[int] = ()) -> PitchTrack:
    """Return a recording on an even clock, with rotors in the order of a rig.

    Args:
        recording: with time_s and theta_rad; other channels are optional.
        motors: motor number in the recording for each rotor of the rig; empty for its order.

    Raises:
        InputError: time, attitude or a motor number is missing.
    """
    for name in ("time_s", "theta_rad"):
        if name not in recording or not np.isfinite(recording.to_si(name)).any():
            raise InputError(f"the recording has no {name}, needed to plot the attitude")
    time_s, theta = recording.to_si("time_s"), recording.to_si("theta_rad")
    rows = np.flatnonzero(np.isfinite(time_s) & np.isfinite(theta))
    times_s = time_s[rows]
    if len(rows) < 3 or np.ptp(times_s) <= 0.0:
        raise InputError(f"the attitude has {pluralize(len(rows), 'row')}; minimum: 3 rows")
    steps = np.diff(np.unique(times_s))
    log_rate_Hz = 1.0 / float(np.median(steps))
    rate_Hz = float(np.clip(log_rate_Hz, MIN_RATE_HZ, MAX_RATE_HZ))
    clock = float(times_s.min()) + np.arange(int(np.ptp(times_s) * rate_Hz) + 1) / rate_Hz
    numbers = _numbers(recording, motors)
    resampler = Resampler(time_s, clock)
    plate, over, remarks = _surface(recording, resampler, numbers)
    pulses_us, pulse_remarks = _pulses(recording, resampler, numbers)
    if log_rate_Hz < LOW_RATE_HZ:
        remarks.append(f"Attitude was logged at {log_rate_Hz:.3g} Hz and is interpolated linearly.")
    rpm = np.empty((0, len(clock)))
    if any(f"rpm{number}" in recording for number in numbers):
        rpm = np.array(
            [resampler.interpolate(_values(recording, f"rpm{number}")) for number in numbers]
        )
    return PitchTrack(
        rate_Hz=rate_Hz,
        time_s=clock,
        theta_rad=resampler.interpolate(_values(recording, "theta_rad")),
        gyro_rad_s=resampler.interpolate(_values(recording, "gyro_rad_s")),
        reference_rad=resampler.hold(_values(recording, "theta_ref_rad")),
        pwm_us=pulses_us,
        rpm=rpm,
        torque_Nm=resampler.interpolate(_values(recording, "torque_Nm")),
        disturbance_Nm=resampler.interpolate(_values(recording, "disturbance_Nm")),
        plate_z_m=plate,
        distance_m=resampler.interpolate(_values(recording, "distance_m")),
        over=over,
        remarks=(*remarks, *pulse_remarks),
    )


def _values(recording: Recording, name: str) -> Array:
    """Return a channel, blank if missing; speeds in rpm and pulses in microseconds, for display."""
    if name not in recording:
        return np.full(len(recording), np.nan)
    is_raw = recording.channels[recording.index(name)].unit in ("rpm", "pwm_us")
    return recording.column(name) if is_raw else recording.to_si(name)


def _numbers(recording: Recording, motors: Sequence[int]) -> list[int]:
    """Return the motor numbers in the recording, in the order of the rig."""
    matches = filter(None, map(_ROTOR.fullmatch, recording.names))
    numbers = sorted({int(next(filter(None, match.groups()))) for match in matches})
    if not motors:
        return numbers
    for number in motors:
        if number not in numbers:
            listed = ", ".join(map(str, numbers)) or "none"
            raise InputError(f"--motors has motor {number}, but the recording has: {listed}")
    return list(motors)


def _pulses(
    recording: Recording, resampler: Resampler, numbers: Sequence[int]
) -> tuple[Array, list[str]]:
    """Return pulses (n_rotors, n) and remarks on their source."""
    remarks = []
    pulses = []
    for number in numbers:
        if f"pwm{number}_us" in recording:
            pulses.append(resampler.hold(_values(recording, f"pwm{number}_us")))
        elif f"motor{number}_share" in recording:
            pulses.append(
                1000.0 + 1000.0 * resampler.hold(_values(recording, f"motor{number}_share"))
            )
            remarks.append("Outputs were logged as shares: 0 to 1 is shown as 1000 to 2000 µs.")
    if len(pulses) < len(numbers) or not np.isfinite(pulses).any():
        return np.empty((0, len(resampler.clock))), []
    times_s = np.unique(resampler.find_readings(_values(recording, f"pwm{numbers[0]}_us"))[0])
    rate_Hz = 1.0 / float(np.median(np.diff(times_s))) if len(times_s) > 2 else np.inf
    if rate_Hz < LOW_RATE_HZ:
        remarks.append(
            f"Outputs were logged at {rate_Hz:.3g} Hz and are held between rows; changes by the "
            f"controller between rows are missing."
        )
    return np.array(pulses), list(dict.fromkeys(remarks))


def _surface(
    recording: Recording, resampler: Resampler, numbers: Sequence[int]
) -> tuple[Array, Array, list[str]]:
    """Return plate distance (n,), coverage of each rotor (n_rotors, n), and remarks."""
    plate = resampler.hold(_values(recording, "plate_z_m"))
    is_parked = ~(plate < MIN_PARKED_Z_M)
    plate = np.where(is_parked, PARKED_M, plate)
    names = [f"coverage{number}" for number in numbers or [1]]
    over = np.nan_to_num([resampler.hold(_values(recording, name)) for name in names])
    if "plate_z_m" in recording and not any(name in recording for name in names):
        over[0] = (~is_parked).astype(float)
        return plate, over, [UNDER_FIRST]
    return plate, over, []


# 2 deg: limit of errors by noise and initial state; 0.2 to 0.4 deg on the virtual bench; assumed.
MIN_LIMIT_RAD = 0.035

# Limit of the RMS error over the standard deviation of the log: 1 is the error of a constant; a
# closed loop has independent noise, and 2 is the error of the opposite motion.
MAX_RELATIVE_ERROR = {"pulses": 1.0, "controller": 2.0}

MAX_RANGE_RATIO = 5.0  # of the simulated range to the recorded one; assumed

_CHECK = "check the model, the order of motors (--motors), and that the vehicle was in the air"


def resample_to_log(track: PitchTrack, time_s: Array, theta_rad: Array) -> Array:
    """Return a simulated pitch (m,) at the recording's times (n,); nan beyond its end."""
    rows = np.searchsorted(time_s, track.time_s)
    theta = theta_rad[np.minimum(rows, len(theta_rad) - 1)]
    return np.where(rows < len(theta_rad), theta, np.nan)


def tracking_error(track: PitchTrack, time_s: Array, theta_rad: Array, by: str) -> str:
    """Return a warning if a simulated run does not follow its log, else "".

    Compared over the whole log, and over the rows above a surface.

    Args:
        time_s, theta_rad: (m,) of the simulated run; nan at restarts.
        by: drive, "pulses" or "controller".
    """
    error_rad = track.theta_rad - resample_to_log(track, time_s, theta_rad)
    deviation_rad = track.theta_rad - np.nanmean(track.theta_rad)
    for rows, where in (
        (np.ones(len(track), bool), ""),
        (track.max_coverage > 0.0, " over the surface"),
    ):
        rms_rad, sd_rad = _rms(error_rad[rows]), _rms(deviation_rad[rows])
        limit_rad = max(MAX_RELATIVE_ERROR[by] * sd_rad, MIN_LIMIT_RAD)
        if rms_rad > limit_rad:
            reason = f"standard deviation of the log: {np.degrees(sd_rad):.1f}°"
            if limit_rad == MIN_LIMIT_RAD:
                reason += f"; noise limit: {np.degrees(MIN_LIMIT_RAD):.0f}°"
            elif by == "pulses":
                reason += ", the error of a constant"
            else:
                reason += ", half the error of the opposite motion"
            return (
                f"The simulated run does not follow the log and is no result: its error is "
                f"{np.degrees(rms_rad):.1f}° RMS{where}; allowed: {np.degrees(limit_rad):.1f}° "
                f"({reason}); {_CHECK}."
            )
    finite = theta_rad[np.isfinite(theta_rad)]
    recorded_rad = np.concatenate([track.theta_rad, track.reference_rad])
    recorded_rad = recorded_rad[np.isfinite(recorded_rad)]
    simulated, recorded = float(np.ptp(finite)), float(np.ptp(recorded_rad))
    if simulated < MAX_RANGE_RATIO * max(recorded, MIN_LIMIT_RAD):
        return ""
    return (
        f"The simulated run does not follow the log and is no result: its range is "
        f"{np.degrees(simulated):.0f}°, that of the log {np.degrees(recorded):.1f}°; {_CHECK}."
    )


def _rms(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else 0.0
