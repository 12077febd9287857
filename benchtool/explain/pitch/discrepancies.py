"""How pitch recordings may depart from every law: torques, speeds and readings without a name.

A torque on the hinge, a speed of a rotor, or a reading that is a smooth function of what it may
depend on, as large as its tolerance says. What it does to the innovations follows from the filter
alone: its gains are constant, so that an error that it does not know of runs through it linearly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.signal import lfilter, ss2tf

from benchtool.core.array_type import Array
from benchtool.explain.engine.evidence import Discrepancy
from benchtool.explain.engine.smooth import smooth_root
from benchtool.explain.pitch.filter import FilterResult, PitchFilter
from benchtool.physics.effects.effect import Subsystem
from benchtool.physics.model import Model
from benchtool.physics.tilt import height_over
from benchtool.simulate.pitch import filter_ticks
from benchtool.simulate.pitch.lane import plane_below

WITHIN = 1.0 / 3.0  # standard deviation over tolerance, as that of effects within theirs

LENGTH, DISTANCE, TIME = 0.3, 0.5, 0.25
"""Over what change a departure looks different: of the range seen, of the logarithm of distance, of
the duration of a recording."""

NEAR, NEAREST = 3.0, 0.1  # z/R of half a departure, and the least counted; assumed
STICKS_RAD_S = 0.01  # rates below are alike: half a degree a second; assumed
BEFORE_S = 0.02  # readings over which an angle or a rate is averaged
APART = 100.0  # lengths between functions that have nothing to do with each other
COARSE = 0.05  # places are rounded to so much of a length
MOST_NUMBERS = 1_000_000  # filtered at a time: half an hour in 100 MB

DEPENDS = {  # what a departure of each kind may depend on
    "torque": ("angle", "rate", "thrust", "time", "distance"),
    "speed": ("pulse", "time", "distance"),
    "reading": ("angle", "rate"),
}

STAGES: dict[str, Subsystem] = {"torque": "hinge", "speed": "pwm_to_rpm", "reading": "sensor"}
PHRASES = {  # what a departure beyond tolerance means; of others: something that depends on it
    "torque: distance": "a different law of thrust against distance",
    "torque: angle": "a torque that depends on the angle",
    "torque: rate": "a torque that depends on the rate",
    "torque: thrust": "a torque that depends on the thrust",
    "torque: time": "a torque that changes with time",
    "reading: angle": "an encoder's error that depends on the angle",
    "reading: rate": "a gyro's error that depends on the rate",
}

White = Callable[[Array], Array]  # innovations (2 + discs, n, r) -> rows (n_rows, r)


@dataclass(frozen=True, eq=False)
class DiscrepancySimulation:
    """Hold what departures in one recording depend on and what they do."""

    log: FilterResult
    model: Model
    over: int  # number of the disc over the plate
    number: int  # of the recording
    white: White

    @cached_property
    def speed(self) -> Array:
        """Speeds of the discs (discs, n): rad/s, from pulses where they were not read."""
        p = self.model.rig.propulsion
        logged = self.log.logged
        pulsed = p.speed_per_us_rad_s * np.maximum(logged.pwm_us - p.pwm_start_us, 0.0)
        return np.where(np.isfinite(logged.speed_rad_s), logged.speed_rad_s, pulsed)

    @cached_property
    def thrust(self) -> Array:
        """Thrusts of the discs far from the plate (discs, n): N."""
        return np.asarray(self.model.rig.propulsion.thrust_coefficient_N_s2 * self.speed**2, float)

    @cached_property
    def rate(self) -> Array:
        """Rate of the beam (n,): rad/s."""
        read = np.nan_to_num(self.log.logged.gyro_rad_s)
        angle = np.nan_to_num(self.log.logged.theta_rad)
        return read if read.any() else np.gradient(angle) * self.log.logged.rate_Hz

    def values(self, depends: str) -> Array:
        """Return what a departure depends on (n,), in lengths where those are its own; nan: none.

        `LENGTH` of the range seen is the length of the others.
        """
        logged = self.log.logged
        rows = round(BEFORE_S * logged.rate_Hz)
        if depends in ("angle", "rate"):
            return _before(
                np.nan_to_num(logged.theta_rad) if depends == "angle" else self.rate, rows
            )
        if depends == "slowness":  # a law of friction differs most where the beam sticks
            return np.log(np.maximum(np.abs(self.values("rate")), STICKS_RAD_S))
        if depends == "thrust":
            return np.asarray(self.thrust.sum(axis=0), float)
        if depends == "pulse":
            return np.asarray(logged.pwm_us.mean(axis=0), float)
        if depends == "time":
            return APART * self.number + np.arange(len(logged)) / len(logged) / TIME
        ratio = np.maximum(self.height_m / self.model.rig.propulsion.radius_m, NEAREST)
        return np.where(logged.plate_share > 0.0, np.log(ratio) / DISTANCE, np.nan)

    @cached_property
    def height_m(self) -> Array:
        """Height of the disc over the plate above it (n,), as the beam tilts."""
        plane = plane_below(self.log.logged.plate_z_m, self.values("angle"), 0.0)
        x_m, y_m = self.model.rig.disc_positions_m[self.over, :2]
        return np.asarray(height_over(plane, x_m, y_m), float)

    def rows(self, channel: Literal["torque", "pitch", "gyro"], errors: Array) -> Array:
        """Return whitened rows (n_rows, r) of torques in N m, or of errors of a sensor (n, r)."""
        parts = []
        for block in np.array_split(errors, 1 + errors.size // MOST_NUMBERS, axis=1):
            shown = np.zeros((2 + len(self.speed), *block.shape))
            if channel == "torque":
                shown[:2] = self.errors.of_torque(block)
            else:
                shown[:2] = self.errors.of_reading(int(channel == "gyro"), block)
            parts.append(self.white(shown))
        return np.hstack(parts)

    def changed(self, name: str, root: Array) -> tuple[Array, Array]:
        """Return innovations (2 + discs, n, r) and shares (n, r) of smooth functions (n, r)."""
        channel, _, depends = name.partition(": ")
        may = self.model.discrepancy
        shown = np.zeros((2 + len(self.speed), *root.shape))
        if channel == "torque":
            arms_m, thrust_N = np.abs(self.model.rig.disc_positions_m[:, 0]), self.thrust
            if depends == "distance":
                near = (self.height_m / self.model.rig.propulsion.radius_m / NEAR) ** 2
                root = (self.log.logged.plate_share / (1.0 + near))[:, None] * root
                arms_m, thrust_N = arms_m[[self.over]], thrust_N[[self.over]]
            share = WITHIN * (may.thrust if depends == "distance" else may.torque) * root
            shown[:2] = self.errors.of_torque((arms_m @ thrust_N)[:, None] * share)
        elif channel == "speed":
            share = WITHIN * may.speed * root
            rate_Hz = self.log.logged.rate_Hz
            keeps = np.exp(-1.0 / (self.model.rig.propulsion.lag_s * rate_Hz))
            late = [0.0, 1.0 - keeps], [1.0, -keeps * (1.0 - self.log.filter.gains[6])]
            shown[2:] = lfilter(*late, self.speed[:, :, None] * share, axis=1)
        else:
            row, usual = (0, np.std(self.values("angle"))), (1, np.std(self.rate))
            place, typical = row if depends == "angle" else usual
            size = may.encoder_rad if depends == "angle" else may.gyro * float(typical)
            error = WITHIN * size * root
            share = error / float(typical)
            shown[:2] = self.errors.of_reading(place, error)
        return shown, share

    def seen(self, name: str, root: Array) -> tuple[Array, Array]:
        """Return whitened rows (n_rows, r), and shares of readings, of smooth functions (n, r)."""
        shown, share = self.changed(name, root)
        rows = self.white(shown)
        channels = rows.reshape(-1, self.log.n_rows, rows.shape[1])
        touched = np.asarray(channels.any(axis=(1, 2)))[:, None, None]
        return rows, (touched * self.log.rows(share)).reshape(rows.shape)

    @cached_property
    def errors(self) -> FilterErrors:
        logged = self.log.logged
        edges = {0, *np.flatnonzero(logged.mode == filter_ticks.RESTART), len(logged)}
        pieces = [slice(a, b) for a, b in pairwise(sorted(edges))]
        return FilterErrors(
            self.log.filter, logged.rate_Hz, self.model.rig.body.inertia_yy_kgm2, pieces
        )


class FilterErrors:
    """Run errors through the filter: what it does not know of shows in its innovations."""

    def __init__(
        self, filter_: PitchFilter, rate_Hz: float, inertia_kgm2: float, pieces: list[slice]
    ) -> None:
        dt = 1.0 / rate_Hz
        self._pieces, self._step = pieces, filter_.step
        self._push = np.array([[dt**2 / 2.0], [dt], [0.0]]) / inertia_kgm2
        self._gain = filter_.gains[:6].reshape(3, 2)
        self._seen = np.eye(3)[:2]

    def of_torque(self, torque: Array) -> Array:
        """Return innovations (2, n, r) of torques (n, r) in N m."""
        return self._run(self._push, np.zeros((2, 1)), torque)

    def of_reading(self, row: int, error: Array) -> Array:
        """Return innovations (2, n, r) of errors (n, r) in a reading: pitch 0, gyro 1."""
        direct = np.eye(2)[:, row : row + 1]
        return self._run(-self._step @ self._gain @ direct, direct, error)

    def _run(self, into: Array, direct: Array, values: Array) -> Array:
        closed = self._step @ (np.eye(3) - self._gain @ self._seen)
        above, below = ss2tf(closed, into, self._seen, direct)
        return np.array(
            [
                np.concatenate([lfilter(row, below, values[part], axis=0) for part in self._pieces])
                for row in above
            ]
        )


def _before(read: Array, rows: int) -> Array:
    """Return the mean of so many readings (n,) before each, which no noise of its own is in."""
    total = np.cumsum(np.concatenate([np.full(rows + 1, read[0]), read]))
    return np.asarray((total[rows:-1] - total[: -rows - 1]) / rows, float)


def discrepancies(logs: Sequence[DiscrepancySimulation]) -> Iterator[Discrepancy]:
    """Give the discrepancies of recordings whose rows lie one after the other."""
    for channel, variables in DEPENDS.items():
        for depends in variables:
            if (roots := smooth(logs, depends)) is None:
                continue
            name = f"{channel}: {depends}"
            columns, shares = [], []
            for log, root in zip(logs, roots, strict=True):
                count = min(root.shape[1], 1 + root.size // MOST_NUMBERS)
                blocks = np.array_split(root, count, axis=1)
                parts = [log.seen(name, block) for block in blocks]
                columns.append(np.hstack([rows for rows, _ in parts]))
                shares.append(np.hstack([share for _, share in parts]))
            rows = np.concatenate(columns)
            if rows.any():
                phrase = PHRASES.get(name, f"something in the {channel} that depends on {depends}")
                yield Discrepancy(
                    name=name,
                    stage=STAGES[channel],
                    phrase=phrase,
                    columns=rows,
                    shares=np.concatenate(shares),
                )


def smooth(logs: Sequence[DiscrepancySimulation], depends: str) -> list[Array] | None:
    """Return smooth functions (n, r) of size 1 over a variable, for each recording.

    The same functions of it in all; None where it hardly changes.
    """
    parts = [log.values(depends) for log in logs]
    values = np.concatenate(parts)
    known = np.isfinite(values)
    if np.mean(known) < 0.01:
        return None
    places = values[known]
    if depends not in ("time", "distance"):
        low, high = np.quantile(places, [0.01, 0.99])
        if not high - low > 1e-9:
            return None
        places = np.clip(places, low, high) / (LENGTH * (high - low))
    root = smooth_root(places[:, None], COARSE)
    whole = np.zeros((len(values), root.shape[1]))
    whole[known] = root
    return np.split(whole, np.cumsum([len(part) for part in parts])[:-1])
