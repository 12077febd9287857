"""Pitch log of a recording, prepared for a filter, with warnings on repairs and gaps."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import savgol_filter

from benchtool.core.errors import InputError
from benchtool.core.recording import Recording, check_rotor_count
from benchtool.core.rig import Rig
from benchtool.core.schedule import PARKED_M
from benchtool.core.units import Array
from benchtool.explain.pitch.resampling import (
    HELD_S,
    MAX_GAP_S,
    READ_S,
    TRANSIT_S,
    ResampledRecording,
    blank_for,
    find_segments,
    is_plate_moving,
    resample_evenly,
)
from benchtool.explain.pitch.sanity_checks import (
    bridge_gaps,
    check_consistency,
    check_motion,
    match_speeds,
)
from benchtool.explain.pitch.timing import align_channels, bench_numbers
from benchtool.explain.recording_checks import repair_readings
from benchtool.simulate.pitch.filter_log import MIN_PARKED_Z_M, LoggedPitch

PLATE_SMOOTHING_S = 0.2  # width of the median; 1 mm matters near the plate

# Width of the quadratic through measured speeds that drive a plant: about a motor's lag. Wider ones
# smooth dither, narrower ones leave reading noise in the thrust.
SPEED_SMOOTHING_S = 0.025

MAX_SAMPLE_INTERVAL_S = 0.012  # of a drive, half a motor lag; assumed
MAX_RATE_DEFICIT = 0.1  # of pulses relative to angles; assumed
INTEGER_TOLERANCE = 0.02  # of the number of readings per row; assumed
EXACT_RAD = 1e-4  # noise and quantum of an encoder that resolves single pulses; assumed
MIN_SEGMENT_S = 1.5  # a filter settles in 0.3 s and a prediction lasts 1 s; assumed
MIN_DURATION_S = 4.0  # shorter recordings do not identify effects; assumed


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PitchLog:
    """Log with its warnings."""

    logged: LoggedPitch
    name: str  # of the file, for display
    remarks: tuple[str, ...]  # repairs and missing channels

    def bench_numbers(self, rig: Rig) -> dict[str, float]:
        """Return speed over pulse and acceleration over thrust."""
        return bench_numbers(self.logged, rig)


def pitch_log(
    recording: Recording,
    rig: Rig,
    name: str = "",
    plate_slide_s: float | None = None,
    *,
    checked: bool = True,
) -> PitchLog:
    """Return the log of a recording.

    Args:
        name: name in messages; default: its file.
        plate_slide_s: duration of a plate slide in or out; None if unknown.
        checked: False skips checks of units, signs and clocks (simulated experiments).

    Raises:
        InputError: time, pitch or a drive (pulses or rotor speeds) is missing, or it is too short.
    """
    name = name or recording.provenance.get("file", "the recording")
    for channel in ("time_s", "theta_rad"):
        if not _has(recording, channel):
            raise InputError(
                f"{name} has no {channel}; map a column to it in the model's [columns], or record "
                f"with benchtool record"
            )
    angles = recording.to_si("theta_rad")[np.isfinite(recording.to_si("theta_rad"))]
    if len(angles) > 1 and np.ptp(angles) == 0.0:
        raise InputError(
            f"theta_rad of {name} is {angles[0]:g} in every row: sensor failure or blocked beam; "
            f"repair the sensor or release the beam, and record again"
        )
    recording, repairs = repair_readings(recording, rig, name)
    rows = resample_evenly(recording, name)
    pulsed = _find_drive(recording, rig, "pwm{}_us")
    measured = _find_drive(recording, rig, "rpm{}")
    check_rotor_count(recording, rig, name, lacking=not pulsed and not measured)
    if not pulsed and not measured:
        raise InputError(
            f"{name} has neither the pulses nor the speeds of all {rig.n_discs} rotors, needed to "
            f"drive the plant; map pwm1_us... or rpm1... in the model's [columns]"
        )
    drive = pulsed or measured
    remarks = [*repairs, *rows.remarks, *_check_drive_rate(recording, drive, rig, name)]
    rows = _select_usable(rows, drive, name, plate_slide_s, remarks)
    recording, mode, rate_Hz = rows.recording, rows.mode, rows.rate_Hz
    n = len(recording)
    blank = np.full(n, np.nan)

    def optional(channel: str) -> Array:
        return recording.to_si(channel) if channel in recording else blank

    speeds = np.array([optional(f"rpm{rotor + 1}") for rotor in rig.first_rotors])
    if pulsed:
        pulses = np.array([recording.column(name) for name in pulsed])
        if not np.isfinite(speeds).any():
            remarks.append("no rpm: lag, delay and sag are judged from the motion alone")
    else:
        p = rig.propulsion
        pulses = p.pwm_start_us + _driving_speeds(speeds, mode, rate_Hz) / p.speed_per_us_rad_s
        speeds = np.full_like(speeds, np.nan)
        remarks.append(
            "no pulses: driven by measured speeds, so effects between pulse and speed (lag, delay, "
            "battery sag) cannot be judged; record pwm too"
        )
    gyro = optional("gyro_rad_s")
    if not np.isfinite(gyro).any():
        remarks.append("no gyro: its bias and scale cannot be judged")
    plate = optional("plate_z_m")
    if not np.isfinite(plate).any():
        remarks.append("no plate_z_m: the plate is assumed to be parked")
        plate = np.full(n, PARKED_M)
    plate = _smooth(last_known(plate), rate_Hz)
    share = optional("coverage1")
    logged = LoggedPitch(
        rate_Hz=rate_Hz,
        pwm_us=np.array([last_known(row) for row in pulses]),
        plate_z_m=plate,
        plate_share=np.where(np.isfinite(share), share, plate < MIN_PARKED_Z_M),
        theta_rad=recording.to_si("theta_rad"),
        gyro_rad_s=gyro,
        speed_rad_s=speeds,
        mode=mode,
        from_speeds=not pulsed,
    )
    if checked:
        logged, swaps = match_speeds(logged, rig)
        check_consistency(logged, rig, name)
        logged, shifts = align_channels(logged, rig, name)
        remarks += (*swaps, *shifts)
    remarks += filter(None, [check_motion(logged, rig)])
    return PitchLog(logged=logged, name=name, remarks=tuple(remarks))


def _find_drive(recording: Recording, rig: Rig, pattern: str) -> tuple[str, ...]:
    """Return the drive channels of all discs; empty if one is missing."""
    names = tuple(pattern.format(rotor + 1) for rotor in rig.first_rotors)
    return names if all(_has(recording, name) for name in names) else ()


def _check_drive_rate(
    recording: Recording, drive: tuple[str, ...], rig: Rig, name: str
) -> list[str]:
    """Return warnings on a low sampling rate of the drive.

    Raises:
        InputError: the rate is below the minimum.
    """
    warnings, channel = list[str](), drive[0]
    time_s = recording.to_si("time_s")
    steps = np.diff(time_s[np.isfinite(recording.column(channel)) & np.isfinite(time_s)])
    step_s = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    if step_s > 1.05 * HELD_S:
        raise InputError(
            f"sampling rate of {channel} in {name} is {1.0 / step_s:.3g} Hz; minimum: "
            f"{1.0 / HELD_S:g} Hz, recommended: 100 Hz; record faster"
        )
    if step_s > MAX_SAMPLE_INTERVAL_S:
        warnings.append(
            f"sampling rate of {channel} is {1.0 / step_s:.3g} Hz: changes within "
            f"{1000.0 * step_s:.0f} ms are not resolved; record it at 100 Hz"
        )
    sensor = rig.sensors.get("theta_rad")
    if sensor is None or not channel.startswith("pwm"):
        return warnings
    ratio = step_s * sensor.rate_Hz
    is_exact = hypot(sensor.noise, sensor.quantum) <= EXACT_RAD
    is_decimated = ratio > 1.5 and abs(ratio - round(ratio)) < INTEGER_TOLERANCE
    if (is_exact and ratio > 1.0 + MAX_RATE_DEFICIT) or is_decimated:
        result = "a gap that no effect explains" if is_exact else "an apparent lag"
        warnings.append(
            f"sampling rate of {channel} is {1.0 / step_s:.3g} Hz, and the beam of rig {rig.name} "
            f"is read at {sensor.rate_Hz:g} Hz: pulses of a faster loop between rows are not "
            f"recorded, which causes {result}; record outputs and attitude at the rate of the "
            f"loop, here {sensor.rate_Hz:g} Hz"
        )
    return warnings


def _select_usable(
    rows: ResampledRecording,
    drive: tuple[str, ...],
    name: str,
    plate_slide_s: float | None,
    remarks: list[str],
) -> ResampledRecording:
    """Return the rows with known drive and angle, that a filter can use.

    Raises:
        InputError: too few rows in total or in one segment.
    """
    blank = blank_for(rows.recording.column("theta_rad"), rows.rate_Hz, MAX_GAP_S)
    for channel in drive:
        blank |= blank_for(rows.recording.column(channel), rows.rate_Hz, HELD_S)
    if blank.any():
        remarks.append(
            f"{blank.sum() / rows.rate_Hz:.2f} s without angle or drive; judged in parts"
        )
    sliding, n_slides = np.zeros(len(blank), bool), 0
    has_coverage = _has(rows.recording, "coverage1") or not _has(rows.recording, "plate_z_m")
    if plate_slide_s != 0.0 and not has_coverage:  # the coverage is unknown during a slide
        reach_s = TRANSIT_S if plate_slide_s is None else plate_slide_s + READ_S
        plate_m = last_known(rows.recording.to_si("plate_z_m"))
        sliding, n_slides = is_plate_moving(plate_m, rows.rate_Hz, reach_s)
    if n_slides:
        remarks.append(
            f"{(sliding & ~blank).sum() / rows.rate_Hz:.2f} s dropped in which the plate "
            f"slides in or out with unknown coverage of the disc; record coverage1, or set "
            f"plate_slide_s of the model if it is faster"
        )
    rows = rows.select(~(blank | sliding))
    is_early = np.zeros(len(rows.mode), bool)
    has_angle = np.isfinite(rows.recording.column("theta_rad"))
    for part in find_segments(rows.mode):
        is_early[part.start : part.start + int(np.argmax(has_angle[part]))] = True
    rows = rows.select(~is_early)
    duration_s = len(rows.mode) / rows.rate_Hz
    if duration_s < MIN_DURATION_S:
        raise InputError(
            f"recording {name} is too short: {duration_s:.1f} s; minimum: {MIN_DURATION_S:g} s; "
            f"recommended: 30 s with several collectives and plate distances"
        )
    longest = max(part.stop - part.start for part in find_segments(rows.mode))
    longest_s = longest / rows.rate_Hz
    if longest_s < MIN_SEGMENT_S:
        raise InputError(
            f"longest segment of {name} without dropouts is {longest_s:.2f} s; minimum: "
            f"{MIN_SEGMENT_S:g} s; record without dropouts"
        )
    return rows


def _has(recording: Recording, name: str) -> bool:
    return name in recording and bool(np.isfinite(recording.to_si(name)).any())


def _driving_speeds(speeds: Array, mode: Array, rate_Hz: float) -> Array:
    """Return rotor speeds (n_discs, n), interpolated and smoothed, to drive a plant."""
    width = 2 * round(0.5 * SPEED_SMOOTHING_S * rate_Hz) + 1
    smooth = np.array([bridge_gaps(readings) for readings in speeds])
    for row in smooth:
        for part in find_segments(mode):
            if part.stop - part.start >= width > 3:
                row[part] = savgol_filter(row[part], width, 2)
    return np.asarray(np.maximum(smooth, 0.0), float)


def last_known(values: Array) -> Array:
    """Return values with gaps filled by the previous value, a first gap by the next one."""
    indices = np.flatnonzero(np.isfinite(values))
    if not len(indices):
        return values
    previous = np.searchsorted(indices, np.arange(len(values)), side="right") - 1
    filled: Array = values[indices[np.maximum(previous, 0)]]
    return filled


def _smooth(plate_m: Array, rate_Hz: float) -> Array:
    """Return smoothed plate distances; parked ones are `PARKED_M`."""
    width = 2 * round(0.5 * PLATE_SMOOTHING_S * rate_Hz) + 1
    is_parked = plate_m >= MIN_PARKED_Z_M
    smooth: Array = median_filter(plate_m, size=width, mode="nearest")
    smooth = np.where((smooth >= MIN_PARKED_Z_M) == is_parked, smooth, plate_m)
    return np.where(is_parked, PARKED_M, smooth)
