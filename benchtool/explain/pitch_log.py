"""From a recording to a pitch log that can be followed, with what was mended and what it lacks."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.signal import savgol_filter

from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.core.schedule import PARKED_M
from benchtool.errors import InputError
from benchtool.simulate import pitch_track as t
from benchtool.simulate.pitch_follow import LoggedPitch
from benchtool.simulate.pitch_replay import PARKED_FROM_M

Array = NDArray[np.float64]

PLATE_SMOOTHING_S = 0.2
"""Width of the median over plate readings: a plate moves slowly and its sensor is noisy, and near
the plate a millimetre is felt."""

SPEED_SMOOTHING_S = 0.025
"""Width of the quadratic through readings of speed that drive a plant: about a motor's lag, within
which speeds cannot kink. Wider ones round off dither; narrower ones leave more of the readings'
noise in the thrust."""

LONGEST_STEP = 1.5
"""A step in time longer than this many usual ones is a gap."""

SHORTEST_S = 4.0
"""Below this length a recording says next to nothing about any effect; a choice."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PitchLog:
    """Hold a log with what is said about it.

    Attributes:
        logged: what is followed.
        reference_rad: (n,) what the controller was told; None where nothing tells.
        name: of the file, for people.
        remarks: what was mended, and what the log lacks.
        driven_by: "pwm" or "rpm".
    """

    logged: LoggedPitch
    reference_rad: Array | None
    name: str
    remarks: tuple[str, ...]
    driven_by: str

    @property
    def duration_s(self) -> float:
        """How long it is."""
        return len(self.logged) / self.logged.rate_Hz


def pitch_log(recording: Recording, rig: Rig, name: str = "") -> PitchLog:
    """Return the log of a recording.

    Raises:
        InputError: a recording without time, without pitch, or with neither pulses nor rotor
            speeds; one that is too short.
    """
    name = name or recording.provenance.get("file", "the recording")
    for needed, why in (("time_s", "when"), ("theta_rad", "how far the beam turned")):
        if needed not in recording or not np.isfinite(recording.si(needed)).any():
            raise InputError(
                f"{name} has no {needed}, so nothing tells {why}; map a column to it in the "
                f"model's [columns], or record with benchtool record"
            )
    remarks: list[str] = []
    recording, mode, rate_Hz = _evenly(recording, name, remarks)
    n = len(recording)
    if n / rate_Hz < SHORTEST_S:
        raise InputError(
            f"{name} is {n / rate_Hz:.1f} s long; an explanation needs {SHORTEST_S:g} s at least, "
            f"and 30 s with several collectives and plate distances to tell effects apart"
        )
    nothing = np.full(n, np.nan)

    def optional(channel: str) -> Array:
        return recording.si(channel) if channel in recording else nothing

    discs = [int(np.argmax(rig.disc_of_rotor == disc)) + 1 for disc in range(rig.n_discs)]
    speeds = np.array([optional(f"rpm{rotor}") for rotor in discs])
    pulses = np.array(
        [
            recording.column(name) if name in recording else nothing
            for name in (f"pwm{rotor}_us" for rotor in discs)
        ]
    )
    driven_by = "pwm"
    if not np.isfinite(pulses).any(axis=1).all():
        if not np.isfinite(speeds).any(axis=1).all():
            raise InputError(
                f"{name} tells neither the pulses nor the speeds of all {rig.n_discs} rotors, so "
                f"the plant cannot be driven; map pwm1_us... or rpm1... in the model's [columns]"
            )
        p = rig.propulsion
        pulses = p.pwm_start_us + _turned(speeds, mode, rate_Hz) / p.speed_per_us_rad_s
        speeds = np.full_like(speeds, np.nan)
        driven_by = "rpm"
        remarks.append(
            "no pulses: driven by the speeds that were measured, so nothing between pulse and "
            "speed (lag, delay, battery sag) can be judged; record pwm too"
        )
    elif not np.isfinite(speeds).any():
        remarks.append("no rpm: lag, delay and sag are judged by the motion alone")
    gyro = optional("gyro_rad_s")
    if not np.isfinite(gyro).any():
        remarks.append("no gyro: its bias and scale cannot be judged")
    plate = optional("plate_z_m")
    if not np.isfinite(plate).any():
        remarks.append("no plate_z_m: the plate is taken to be parked")
        plate = np.full(n, PARKED_M)
    for channel, values in (("theta_rad", recording.si("theta_rad")), ("gyro_rad_s", gyro)):
        known = values[np.isfinite(values)]
        if len(known) > 1 and np.ptp(known) == 0.0:
            raise InputError(
                f"{channel} of {name} is {known[0]:g} in every row: a dead channel; mend the "
                f"sensor or leave the column out"
            )
    plate = _smooth(_held(plate), rate_Hz)
    share = optional("coverage1")
    logged = LoggedPitch(
        rate_Hz=rate_Hz,
        pwm_us=np.array([_held(row) for row in pulses]),
        plate_z_m=plate,
        plate_share=np.where(np.isfinite(share), share, plate < PARKED_FROM_M),
        theta_rad=recording.si("theta_rad"),
        gyro_rad_s=gyro,
        speed_rad_s=speeds,
        mode=mode,
        turned=driven_by == "rpm",
    )
    reference = optional("theta_ref_rad")
    return PitchLog(
        logged=logged,
        reference_rad=reference if np.isfinite(reference).any() else None,
        name=name,
        remarks=tuple(remarks),
        driven_by=driven_by,
    )


def _evenly(recording: Recording, name: str, remarks: list[str]) -> tuple[Recording, Array, float]:
    """Return rows in order, what a filter does at each, and their rate."""
    time_s = recording.si("time_s")
    good = np.isfinite(time_s)
    if not good.all():
        remarks.append(f"{int((~good).sum())} rows without a time were left out")
        recording, time_s = recording.select(good), time_s[good]
    if len(time_s) < 3:
        raise InputError(f"{name} has {len(time_s)} rows with a time; record it again")
    steps = np.diff(time_s)
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    if usual <= 0.0:
        raise InputError(f"time_s of {name} never goes forward; map the right column to it")
    mode = np.full(len(time_s), float(t.CORRECT))
    mode[0] = t.RESTART
    backward, gaps = steps <= 0.0, steps > LONGEST_STEP * usual
    mode[1:][backward | gaps] = t.RESTART
    if backward.any():
        at = float(time_s[1:][backward][0])
        remarks.append(
            f"the clock jumps back {int(backward.sum())} times, first to {at:.3f} s; "
            f"judged in parts"
        )
    if gaps.any():
        at, wide = float(time_s[:-1][gaps][0]), float(steps[gaps].max())
        remarks.append(
            f"{int(gaps.sum())} gaps in time, the first at {at:.3f} s, the longest {wide:.3f} s; "
            f"judged in parts"
        )
    whole = steps[~(backward | gaps)]
    return recording, mode, float(len(whole) / whole.sum())


def _turned(speeds: Array, mode: Array, rate_Hz: float) -> Array:
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


def _held(values: Array) -> Array:
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
