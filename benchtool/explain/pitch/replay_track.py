"""A pitch or flight recording on one even clock: what a figure shows and a replay is driven by."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.errors import InputError
from benchtool.core.plural import pluralize
from benchtool.core.recording import Recording
from benchtool.core.schedule import PARKED_M
from benchtool.simulate.pitch.filter_log import PARKED_FROM_M

LONGEST_GAP_S = 1.0  # longer silences of the attitude are left blank, as in import

SLOWEST_HZ, FASTEST_HZ = 50.0, 500.0
"""Least and greatest rate of the clock: slower logs are filled in between, faster ones thinned. The
loops of pitch benches run at 250 Hz and more, and a figure shows less; choices."""

UNDER_FIRST = (
    "The log does not tell which rotor the plate is under, nor how fast it comes: rotor 1, "
    "at once where plate_z_m is near."
)

CRUDE_HZ = 20.0  # outputs logged more seldom say little of a rate loop; assumed

_ROTOR = re.compile(r"pwm(\d+)_us|motor(\d+)_share|rpm(\d+)")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PitchTrack:
    """Hold a recording on an even clock; nan where nothing was logged.

    Attributes:
        theta_rad, gyro_rad_s, reference_rad: (n,) positive nose down.
        torque_Nm, disturbance_Nm: (n,) what a controller requested, and its estimate.
        plate_z_m: (n,) distance of the plate with the beam level; `PARKED_M` where it is parked.
    """

    rate_Hz: float  # of the clock
    time_s: Array  # (n,) in the recording's own time
    theta_rad: Array
    gyro_rad_s: Array
    reference_rad: Array
    pwm_us: Array  # (n_rotors, n) pulses, each held until the next; empty without
    rpm: Array  # (n_rotors, n) speeds; empty without
    torque_Nm: Array
    disturbance_Nm: Array
    plate_z_m: Array
    distance_m: Array  # (n,) what a sensor that looks down read
    over: Array  # (n_rotors, n) how far each rotor is over a surface, 0 to 1
    remarks: tuple[str, ...] = ()  # what a reader must know of how it was read

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def any_over(self) -> Array:
        """How far any rotor is over a surface (n,)."""
        share: Array = self.over.max(axis=0) if len(self.over) else np.zeros(len(self))
        return share

    @property
    def visits(self) -> list[tuple[int, int]]:
        """First and last row of every stretch with a rotor over a surface."""
        inside = self.any_over > 0.0
        edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(np.int8), [0]])))
        return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]

    def rotors_over(self, first: int, last: int) -> list[int]:
        """Return the numbers of the rotors that are over a surface in these rows."""
        return [
            rotor + 1 for rotor, row in enumerate(self.over) if (row[first : last + 1] > 0.0).any()
        ]


def pitch_track(recording: Recording, motors: Sequence[int] = ()) -> PitchTrack:
    """Return a recording on an even clock, its rotors in the order of a rig.

    Args:
        recording: with time_s and theta_rad; other channels as far as there are any.
        motors: for each rotor of the rig the number that the recording calls it; as they stand
            when empty.

    Raises:
        InputError: there is no time or attitude, or a motor number is not there.
    """
    for name in ("time_s", "theta_rad"):
        if name not in recording or not np.isfinite(recording.to_si(name)).any():
            raise InputError(f"the recording has no {name}, so there is no attitude to draw")
    time_s, theta = recording.to_si("time_s"), recording.to_si("theta_rad")
    rows = np.flatnonzero(np.isfinite(time_s) & np.isfinite(theta))
    at = time_s[rows]
    if len(rows) < 3 or np.ptp(at) <= 0.0:
        raise InputError(
            f"attitude stands in {pluralize(len(rows), 'row')} only; there is nothing to draw"
        )
    steps = np.diff(np.unique(at))
    own_Hz = 1.0 / float(np.median(steps))
    rate_Hz = float(np.clip(own_Hz, SLOWEST_HZ, FASTEST_HZ))
    clock = float(at.min()) + np.arange(int(np.ptp(at) * rate_Hz) + 1) / rate_Hz
    numbers = _numbers(recording, motors)
    read = _Reader(recording, time_s, clock)
    plate, over, remarks = _surface(recording, read, numbers)
    pulses, more = _pulses(recording, read, numbers)
    if own_Hz < CRUDE_HZ:
        remarks.append(f"Attitude was logged at {own_Hz:.3g} Hz; between, it is a straight line.")
    rpm = np.empty((0, len(clock)))
    if any(f"rpm{number}" in recording for number in numbers):
        rpm = np.array([read.line(f"rpm{number}") for number in numbers])
    return PitchTrack(
        rate_Hz=rate_Hz,
        time_s=clock,
        theta_rad=read.line("theta_rad"),
        gyro_rad_s=read.line("gyro_rad_s"),
        reference_rad=read.held("theta_ref_rad"),
        pwm_us=pulses,
        rpm=rpm,
        torque_Nm=read.line("torque_Nm"),
        disturbance_Nm=read.line("disturbance_Nm"),
        plate_z_m=plate,
        distance_m=read.line("distance_m"),
        over=over,
        remarks=(*remarks, *more),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Reader:
    """Put channels of a recording onto a clock."""

    recording: Recording
    time_s: Array
    clock: Array

    def known(self, name: str) -> tuple[Array, Array]:
        """Return times and values of a channel where it has one, in order."""
        if name not in self.recording:
            return np.empty(0), np.empty(0)
        channel = self.recording.channels[self.recording.index(name)]
        # Speeds stay in rpm and pulses in microseconds, as they are drawn.
        own = channel.unit in ("rpm", "pwm_us")
        values = self.recording.column(name) if own else self.recording.to_si(name)
        rows = np.flatnonzero(np.isfinite(values) & np.isfinite(self.time_s))
        rows = rows[np.argsort(self.time_s[rows], kind="stable")]
        return self.time_s[rows], values[rows]

    def line(self, name: str) -> Array:
        """Return a channel (n,) joined by straight lines; blank across gaps and outside."""
        at, values = self.known(name)
        if not at.size:
            return np.full(len(self.clock), np.nan)
        out = np.interp(self.clock, at, values, left=np.nan, right=np.nan)
        return self._without_gaps(at, out)

    def held(self, name: str) -> Array:
        """Return a channel (n,) whose values hold until the next; blank before the first."""
        at, values = self.known(name)
        if not at.size:
            return np.full(len(self.clock), np.nan)
        last = np.searchsorted(at, self.clock + 1e-9, side="right") - 1
        out = np.where(last >= 0, values[np.maximum(last, 0)], np.nan)
        return self._without_gaps(at, out)

    def _without_gaps(self, at: Array, out: Array) -> Array:
        for gap in np.flatnonzero(np.diff(at) > LONGEST_GAP_S):
            out[(self.clock > at[gap]) & (self.clock < at[gap + 1])] = np.nan
        return out


def _numbers(recording: Recording, motors: Sequence[int]) -> list[int]:
    """Return what the recording calls the rotors, in the order of the rig."""
    found = filter(None, map(_ROTOR.fullmatch, recording.names))
    known = sorted({int(next(filter(None, match.groups()))) for match in found})
    if not motors:
        return known
    for number in motors:
        if number not in known:
            listed = ", ".join(map(str, known)) or "none"
            raise InputError(f"--motors names motor {number}, but the recording has: {listed}")
    return list(motors)


def _pulses(recording: Recording, read: _Reader, numbers: Sequence[int]) -> tuple[Array, list[str]]:
    """Return pulses (n_rotors, n), and how they were come by."""
    remarks = []
    rows = []
    for number in numbers:
        if f"pwm{number}_us" in recording:
            rows.append(read.held(f"pwm{number}_us"))
        elif f"motor{number}_share" in recording:
            rows.append(1000.0 + 1000.0 * read.held(f"motor{number}_share"))
            remarks.append("Outputs were logged as shares: 0 to 1 is drawn as 1000 to 2000 µs.")
    if len(rows) < len(numbers) or not np.isfinite(rows).any():
        return np.empty((0, len(read.clock))), []
    at, _ = read.known(f"pwm{numbers[0]}_us")
    if len(at) > 2 and (slow := 1.0 / float(np.median(np.diff(np.unique(at))))) < CRUDE_HZ:
        remarks.append(
            f"Outputs were logged at {slow:.3g} Hz: each is held until the next, though the "
            f"controller changed it between."
        )
    return np.array(rows), list(dict.fromkeys(remarks))


def _surface(
    recording: Recording, read: _Reader, numbers: Sequence[int]
) -> tuple[Array, Array, list[str]]:
    """Return plate distance (n,), how far each rotor is over a surface (n_rotors, n), remarks."""
    n = len(read.clock)
    plate = read.held("plate_z_m")
    parked = ~(plate < PARKED_FROM_M)
    plate = np.where(parked, PARKED_M, plate)
    count = max(len(numbers), 1)
    over = np.zeros((count, n))
    known = False
    for place, number in enumerate(numbers or [1]):
        if f"coverage{number}" in recording:
            over[place] = np.nan_to_num(read.held(f"coverage{number}"))
            known = True
    if not known and "plate_z_m" in recording:
        over[0] = (~parked).astype(float)
        return plate, over, [UNDER_FIRST]
    return plate, over, []


LEAST_RAD = 0.035
"""Two degrees: noise, and what a window begins with, part a right run from its log by less. A
choice; windows of the virtual bench were seen to part by 0.2 to 0.4 degrees."""

FARTHEST = {"pulses": 1.0, "controller": 2.0}
"""How far a run may be from its log, RMS, in swings of the log about its own mean, RMS. From one
on, a line drawn at the log's mean is nearer to the log than a plant under the log's own pulses. A
closed loop has noise of its own: with the same swing, but always the opposite way, it is two
away."""

MAX_TRACKING_ERROR = 5.0  # times the recorded range that a simulated run may cover; assumed

_CHECK = (
    "check that the model is of this vehicle and the order of its motors (--motors), and that it "
    "was in the air"
)


def on_log_clock(track: PitchTrack, time_s: Array, theta_rad: Array) -> Array:
    """Return a simulated pitch (m,) at the recording's times (n,): rad, nan beyond its end."""
    at = np.searchsorted(time_s, track.time_s)
    theta = theta_rad[np.minimum(at, len(theta_rad) - 1)]
    return np.where(at < len(theta_rad), theta, np.nan)


def tracking_error(track: PitchTrack, time_s: Array, theta_rad: Array, by: str) -> str:
    """Return a sentence saying that a simulated run does not follow its log; empty where it does.

    It is held against the whole log, and against what lies over a surface.

    Args:
        time_s: (m,) of the simulated run.
        theta_rad: (m,) of it; nan where it starts anew.
        by: what drove it, "pulses" or "controller".
    """
    apart = track.theta_rad - on_log_clock(track, time_s, theta_rad)
    swing = track.theta_rad - np.nanmean(track.theta_rad)
    for rows, where in (
        (np.ones(len(track), bool), ""),
        (track.any_over > 0.0, " over the surface"),
    ):
        missed_rad, swing_rad = _rms(apart[rows]), _rms(swing[rows])
        limit_rad = max(FARTHEST[by] * swing_rad, LEAST_RAD)
        if missed_rad > limit_rad:
            reason = f"there the log swings by {np.degrees(swing_rad):.1f}° about its mean"
            if limit_rad == LEAST_RAD:
                reason += f", and up to {np.degrees(LEAST_RAD):.0f}° may be noise"
            elif by == "pulses":
                reason += ", so that a line at its mean is nearer to it"
            else:
                reason += ", and the same swing the opposite way is twice that away"
            return (
                f"The simulated run does not follow the log, so it is no result: it misses it by "
                f"{np.degrees(missed_rad):.1f}° RMS{where}, above {np.degrees(limit_rad):.1f}° "
                f"({reason}); {_CHECK}."
            )
    known = theta_rad[np.isfinite(theta_rad)]
    seen = np.concatenate([track.theta_rad, track.reference_rad])
    seen = seen[np.isfinite(seen)]
    most, recorded = float(np.ptp(known)), float(np.ptp(seen))
    if most < MAX_TRACKING_ERROR * max(recorded, LEAST_RAD):
        return ""
    return (
        f"The simulated run does not follow the log, so it is no result: it goes over "
        f"{np.degrees(most):.0f}°, the recorded one over {np.degrees(recorded):.1f}°; {_CHECK}."
    )


def _rms(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else 0.0
