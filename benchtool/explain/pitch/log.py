"""From a recording to a pitch log for a filter, with what was repaired and what it lacks."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import hypot

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import savgol_filter

from benchtool.core.array_type import Array
from benchtool.core.errors import InputError
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.core.rotor_count import check_rotor_count
from benchtool.core.schedule import PARKED_M
from benchtool.explain.pitch.resampling import (
    HELD_S,
    MAX_GAP_S,
    READ_S,
    TRANSIT_S,
    ResampledRecording,
    blank_for,
    is_plate_moving,
    resample_evenly,
)
from benchtool.explain.pitch.sanity_checks import (
    refuse_inconsistent,
    rotors_in_order,
    standing_still,
)
from benchtool.explain.pitch.timing import align_channels
from benchtool.explain.recording_checks import repair_readings
from benchtool.simulate.pitch import filter_ticks as t
from benchtool.simulate.pitch.filter_log import PARKED_FROM_M, LoggedPitch

PLATE_SMOOTHING_S = 0.2
"""Width of the median over plate readings: a plate moves slowly and its sensor is noisy, and near
the plate a millimetre is felt."""

SPEED_SMOOTHING_S = 0.025
"""Width of the quadratic through readings of speed that drive a plant: about a motor's lag, within
which speeds cannot kink. Wider ones round off dither; narrower ones leave more of the readings'
noise in the thrust."""

MAX_SAMPLE_INTERVAL_S = 0.012  # longest step of a drive that a motor follows: half a lag; assumed
SLOWER = 0.1  # share by which pulses may come more seldom than angles; assumed
THINNED = 0.02  # deviation of the readings per row from a whole number; assumed
EXACT_RAD = 1e-4  # noise and quantum of an encoder that shows single pulses; assumed
MAX_SEGMENT_S = 1.5  # a filter settles in 0.3 s and a prediction lasts 1 s; assumed
MIN_SEGMENT_S = 4.0  # below this length a recording says next to nothing about any effect; assumed


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PitchLog:
    """Hold a log with its remarks."""

    logged: LoggedPitch  # what is followed
    name: str  # of the file, for people
    remarks: tuple[str, ...]  # what was repaired, and what the log lacks


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
        name: what messages call it; of its file when left out.
        plate_slide_s: how long its plate takes to slide in or out; None where it is unknown.
        checked: whether units, signs and clocks are checked; False for a simulated experiment.

    Raises:
        InputError: a recording without time, without pitch, or with neither pulses nor rotor
            speeds; one that is too short.
    """
    name = name or recording.provenance.get("file", "the recording")
    for needed, why in (("time_s", "when"), ("theta_rad", "how far the beam turned")):
        if not _has(recording, needed):
            raise InputError(
                f"{name} has no {needed}, so nothing tells {why}; map a column to it in the "
                f"model's [columns], or record with benchtool record"
            )
    known = recording.to_si("theta_rad")[np.isfinite(recording.to_si("theta_rad"))]
    if len(known) > 1 and np.ptp(known) == 0.0:
        raise InputError(
            f"theta_rad of {name} is {known[0]:g} in every row: a dead channel, or a beam that "
            f"is held; mend the sensor or let the beam turn, and record again"
        )
    recording, mended = repair_readings(recording, rig, name)
    rows = resample_evenly(recording, name)
    pulsed = _drive(recording, rig, "pwm{}_us")
    measured = _drive(recording, rig, "rpm{}")
    check_rotor_count(recording, rig, name, lacking=not pulsed and not measured)
    if not pulsed and not measured:
        raise InputError(
            f"{name} tells neither the pulses nor the speeds of all {rig.n_discs} rotors, so "
            f"the plant cannot be driven; map pwm1_us... or rpm1... in the model's [columns]"
        )
    drive = pulsed or measured
    remarks = [*mended, *rows.remarks, *_sparse(recording, drive, rig, name)]
    rows = _followed(rows, drive, name, plate_slide_s, remarks)
    recording, mode, rate_Hz = rows.recording, rows.mode, rows.rate_Hz
    n = len(recording)
    nothing = np.full(n, np.nan)

    def optional(channel: str) -> Array:
        return recording.to_si(channel) if channel in recording else nothing

    speeds = np.array([optional(f"rpm{rotor + 1}") for rotor in rig.first_rotors])
    if pulsed:
        pulses = np.array([recording.column(name) for name in pulsed])
        if not np.isfinite(speeds).any():
            remarks.append("no rpm: lag, delay and sag are judged by the motion alone")
    else:
        p = rig.propulsion
        pulses = p.pwm_start_us + _driving_speeds(speeds, mode, rate_Hz) / p.speed_per_us_rad_s
        speeds = np.full_like(speeds, np.nan)
        remarks.append(
            "no pulses: driven by the speeds that were measured, so nothing between pulse and "
            "speed (lag, delay, battery sag) can be judged; record pwm too"
        )
    gyro = optional("gyro_rad_s")
    if not np.isfinite(gyro).any():
        remarks.append("no gyro: its bias and scale cannot be judged")
    plate = optional("plate_z_m")
    if not np.isfinite(plate).any():
        remarks.append("no plate_z_m: the plate is taken to be parked")
        plate = np.full(n, PARKED_M)
    plate = _smooth(last_known(plate), rate_Hz)
    share = optional("coverage1")
    logged = LoggedPitch(
        rate_Hz=rate_Hz,
        pwm_us=np.array([last_known(row) for row in pulses]),
        plate_z_m=plate,
        plate_share=np.where(np.isfinite(share), share, plate < PARKED_FROM_M),
        theta_rad=recording.to_si("theta_rad"),
        gyro_rad_s=gyro,
        speed_rad_s=speeds,
        mode=mode,
        from_speeds=not pulsed,
    )
    if checked:
        logged, exchanged = rotors_in_order(logged, rig)
        refuse_inconsistent(logged, rig, name)
        logged, late = align_channels(logged, rig, name)
        remarks += (*exchanged, *late)
    remarks += filter(None, [standing_still(logged, rig)])
    return PitchLog(logged=logged, name=name, remarks=tuple(remarks))


def _drive(recording: Recording, rig: Rig, pattern: str) -> tuple[str, ...]:
    """Return the channels that drive every disc; none where one is missing."""
    names = tuple(pattern.format(rotor + 1) for rotor in rig.first_rotors)
    return names if all(_has(recording, name) for name in names) else ()


def _sparse(recording: Recording, drive: tuple[str, ...], rig: Rig, name: str) -> list[str]:
    """Return what to say of a drive that comes seldom.

    Raises:
        InputError: too seldom to follow a plant.
    """
    out = []
    time_s = recording.to_si("time_s")
    for channel in drive[:1]:
        steps = np.diff(time_s[np.isfinite(recording.column(channel)) & np.isfinite(time_s)])
        step_s = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
        if step_s > 1.05 * HELD_S:
            raise InputError(
                f"{channel} of {name} comes {1.0 / step_s:.3g} times a second, which says too "
                f"little of what drove the plant; record it {1.0 / HELD_S:g} times a second at "
                f"least, 100 times to tell effects apart"
            )
        if step_s > MAX_SAMPLE_INTERVAL_S:
            out.append(
                f"{channel} comes {1.0 / step_s:.3g} times a second: what changes within "
                f"{1000.0 * step_s:.0f} ms goes unseen; record it 100 times a second"
            )
        sensor = rig.sensors.get("theta_rad")
        if sensor is None or not drive[0].startswith("pwm"):
            continue
        times = step_s * sensor.rate_Hz
        exact = hypot(sensor.noise, sensor.quantum) <= EXACT_RAD
        thinned = times > 1.5 and abs(times - round(times)) < THINNED
        if (exact and times > 1.0 + SLOWER) or thinned:
            shows = "So exact an encoder shows that as a gap that no effect explains"
            out.append(
                f"{channel} comes {1.0 / step_s:.3g} times a second, and the beam of rig "
                f"{rig.name} is read {sensor.rate_Hz:g} times: pulses that a faster loop gave in "
                f"between turned the beam and are not in the recording. "
                f"{shows if exact else 'That reads as lag'}; record outputs and attitude as fast "
                f"as the loop runs, {sensor.rate_Hz:g} times a second here"
            )
    return out


def _followed(
    rows: ResampledRecording,
    drive: tuple[str, ...],
    name: str,
    plate_slide_s: float | None,
    remarks: list[str],
) -> ResampledRecording:
    """Return the rows along which a plant can be followed: drive and angle known.

    Raises:
        InputError: too few of them, all in all or in one piece.
    """
    blank = blank_for(rows.recording.column("theta_rad"), rows.rate_Hz, MAX_GAP_S)
    for channel in drive:
        blank |= blank_for(rows.recording.column(channel), rows.rate_Hz, HELD_S)
    if blank.any():
        remarks.append(
            f"{blank.sum() / rows.rate_Hz:.2f} s without an angle, or without what drives the "
            f"plant, left out; judged in parts"
        )
    sliding, times = np.zeros(len(blank), bool), 0
    covered = _has(rows.recording, "coverage1") or not _has(rows.recording, "plate_z_m")
    if plate_slide_s != 0.0 and not covered:  # in what rows nobody knows the coverage
        reach_s = TRANSIT_S if plate_slide_s is None else plate_slide_s + READ_S
        plate_m = last_known(rows.recording.to_si("plate_z_m"))
        sliding, times = is_plate_moving(plate_m, rows.rate_Hz, reach_s)
    if times:
        remarks.append(
            f"{(sliding & ~blank).sum() / rows.rate_Hz:.2f} s left out in which the plate slides "
            f"in or out: nothing tells how much of a disc it covers then; record coverage1, or "
            f"say in the model's plate_slide_s that it is faster"
        )
    rows = rows.select(~(blank | sliding))
    early = np.zeros(len(rows.mode), bool)
    edges = [*np.flatnonzero(rows.mode == t.RESTART), len(rows.mode)]
    seen = np.isfinite(rows.recording.column("theta_rad"))
    for first, last in pairwise(edges):
        early[first : first + int(np.argmax(seen[first:last]))] = True
    rows = rows.select(~early)
    length_s = len(rows.mode) / rows.rate_Hz
    if length_s < MIN_SEGMENT_S:
        raise InputError(
            f"{name} is {length_s:.1f} s long; an explanation needs {MIN_SEGMENT_S:g} s at least, "
            f"and 30 s with several collectives and plate distances to tell effects apart"
        )
    edges = [*np.flatnonzero(rows.mode == t.RESTART), len(rows.mode)]
    longest_s = max(last - first for first, last in pairwise(edges)) / rows.rate_Hz
    if longest_s < MAX_SEGMENT_S:
        raise InputError(
            f"the longest piece of {name} without a gap lasts {longest_s:.2f} s, and predictions "
            f"need {MAX_SEGMENT_S:g} s; record without gaps"
        )
    return rows


def _has(recording: Recording, name: str) -> bool:
    return name in recording and bool(np.isfinite(recording.to_si(name)).any())


def _driving_speeds(speeds: Array, mode: Array, rate_Hz: float) -> Array:
    """Return rotor speeds (n_discs, n) that can drive a plant: no gaps, less noise."""
    width = 2 * round(0.5 * SPEED_SMOOTHING_S * rate_Hz) + 1
    rows = np.arange(speeds.shape[1])
    out = np.empty_like(speeds)
    edges = [*np.flatnonzero(mode == t.RESTART), len(rows)]
    for disc, read in enumerate(speeds):
        known = np.isfinite(read)
        out[disc] = np.interp(rows, rows[known], read[known])
        for first, last in pairwise(edges):
            if last - first >= width > 3:
                out[disc, first:last] = savgol_filter(out[disc, first:last], width, 2)
    return np.maximum(out, 0.0)


def last_known(values: Array) -> Array:
    """Return values with each gap filled by the last known one, the first by the next."""
    known = np.flatnonzero(np.isfinite(values))
    if not len(known):
        return values
    last = np.searchsorted(known, np.arange(len(values)), side="right") - 1
    held: Array = values[known[np.maximum(last, 0)]]
    return held


def _smooth(plate_m: Array, rate_Hz: float) -> Array:
    """Return plate distances with their noise taken down; parked stays parked."""
    width = 2 * round(0.5 * PLATE_SMOOTHING_S * rate_Hz) + 1
    parked = plate_m >= PARKED_FROM_M
    smooth: Array = median_filter(plate_m, size=width, mode="nearest")
    smooth = np.where((smooth >= PARKED_FROM_M) == parked, smooth, plate_m)
    return np.where(parked, PARKED_M, smooth)
