"""Schedules of pitch experiments: signals, samples in time, and TOML files."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tomli_w
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from benchtool.core.choices import SignalShape
from benchtool.core.errors import InputError
from benchtool.core.rig import NotNegative, Positive
from benchtool.core.toml_text import FiniteTable, read_strict
from benchtool.core.units import Array
from benchtool.core.user_file import read_library_file

MAX_DURATION_S = 3600.0  # of a run; its recording has several 100 MB; assumed
MAX_PLATE_Z_OVER_R = 100.0  # the effect of a plate is negligible far below that
MIN_BIT_S = 1e-4  # a tenth of a plant step; bounds the memory after a typing error; assumed

MAX_LEVEL = {  # hinge range, thrusts of hover (assumed), servo pulse range
    "reference_deg": (-90.0, 90.0),
    "collective": (0.0, 10.0),
    "dither_us": (-1e3, 1e3),
}

PARKED_M = 1.0  # plate distance of a parked plate, as in pitch recordings


@dataclass(frozen=True, slots=True, kw_only=True)
class Signal(FiniteTable):
    """Signal shape added to a track; the shapes of a track are summed.

    Attributes:
        shape: "step" (level from `from_s` to `to_s`), "ramp" (from 0 at `from_s` to level at
            `to_s`, held), "triangle" (amplitude level, period_s), "chirp" (amplitude level, from
            start_Hz to end_Hz, linear), "prbs" (level or minus level, random with seed every
            bit_s), "steps" (levels in order, every_s each).
        from_s, to_s: active interval; default of `to_s`: end of the schedule.
        level: in the track's unit.
    """

    shape: SignalShape
    level: float = 0.0
    levels: tuple[float, ...] = ()
    from_s: NotNegative = 0.0
    to_s: Positive | None = None
    period_s: Positive = 4.0
    start_Hz: NotNegative = 0.1
    end_Hz: NotNegative = 5.0
    bit_s: Annotated[float, Ge(MIN_BIT_S)] = 0.05
    every_s: Positive = 2.0
    seed: Annotated[int, Ge(0)] = 0

    def __post_init__(self) -> None:
        if self.to_s is not None and self.to_s <= self.from_s:
            raise InputError(
                f"{self.shape} has from_s {self.from_s:g} and to_s {self.to_s:g}; increase to_s"
            )

    def sampled(self, time_s: Array, duration_s: float) -> Array:
        """Return the shape at these times (m,)."""
        end_s = duration_s if self.to_s is None else self.to_s
        t = time_s - self.from_s
        length_s = max(end_s - self.from_s, 1e-12)
        is_active = (t >= -1e-9) & (time_s < end_s - 1e-9)
        if self.shape == "ramp":
            ramp: Array = self.level * np.clip(t / length_s, 0.0, 1.0)
            return ramp
        if self.shape == "triangle":
            phase = np.mod(t / self.period_s + 0.25, 1.0)
            values = self.level * (1.0 - 4.0 * np.abs(phase - 0.5))
        elif self.shape == "chirp":
            sweep_Hz_s = (self.end_Hz - self.start_Hz) / length_s
            values = self.level * np.sin(2.0 * np.pi * t * (self.start_Hz + 0.5 * sweep_Hz_s * t))
        elif self.shape == "prbs":
            count = int(np.ceil(length_s / self.bit_s)) + 1
            signs = np.random.default_rng(self.seed).choice([-1.0, 1.0], count)
            values = self.level * signs[_index(t, self.bit_s, count)]
        elif self.shape == "steps":
            levels = np.array(self.levels or (0.0,))
            values = levels[_index(t, self.every_s, len(levels))]
        else:
            values = np.full_like(time_s, self.level)
        return np.where(is_active, values, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlateVisit(FiniteTable):
    """Visit of the plate: it moves in and later out.

    Attributes:
        z_over_R: distance with the beam level, in rotor radii.
        move_s: duration of each move; the covered fraction changes linearly.
    """

    z_over_R: Annotated[float, Gt(0.0), Le(MAX_PLATE_Z_OVER_R)]
    in_s: NotNegative
    out_s: Positive
    move_s: NotNegative = 0.5

    def share(self, time_s: Array) -> Array:
        """Return the fraction of the visit (m,), 0 (out) to 1 (in)."""
        if self.move_s == 0.0:
            return ((time_s >= self.in_s - 1e-9) & (time_s < self.out_s - 1e-9)).astype(float)
        arriving = np.clip((time_s - self.in_s) / self.move_s, 0.0, 1.0)
        leaving = np.clip((time_s - self.out_s) / self.move_s, 0.0, 1.0)
        share: Array = np.clip(arriving - leaving, 0.0, 1.0)
        return share


@dataclass(frozen=True, slots=True, kw_only=True)
class Switch(FiniteTable):
    """Switch for parts of the controller at a time; None: unchanged."""

    at_s: NotNegative
    observer: bool | None = None
    feedforward: bool | None = None


@dataclass(frozen=True, kw_only=True)
class Schedule(FiniteTable):
    """Timed commands of one pitch run.

    Attributes:
        reference_deg: attitude, signals in degrees, positive nose down.
        collective: signals added to 1, in units of hover thrust.
        dither_us: signals added to the pulses of nose-down rotors and subtracted from the others.
        plate: visits of the plate, in order of time.
    """

    name: str
    title: str
    duration_s: Positive
    reference_deg: tuple[Signal, ...] = ()
    collective: tuple[Signal, ...] = ()
    dither_us: tuple[Signal, ...] = ()
    plate: tuple[PlateVisit, ...] = ()
    switches: tuple[Switch, ...] = ()

    def __post_init__(self) -> None:
        for kind, starts in (
            ("plate", [visit.in_s for visit in self.plate]),
            ("switches", [switch.at_s for switch in self.switches]),
        ):
            if starts != sorted(starts):
                raise InputError(
                    f"{kind} of schedule {self.name!r} are not in order of time; sort them"
                )
        for visit in self.plate:
            if visit.out_s < visit.in_s + visit.move_s:
                raise InputError(
                    f"the plate of schedule {self.name!r} moves out at {visit.out_s:g} s, before "
                    f"it has moved in at {visit.in_s + visit.move_s:g} s; increase out_s"
                )
        for visit, later in pairwise(self.plate):
            if later.in_s < visit.out_s:
                raise InputError(
                    f"the plate of schedule {self.name!r} moves in at {later.in_s:g} s, before it "
                    f"moves out at {visit.out_s:g} s; increase in_s"
                )

    def with_duration(self, duration_s: float) -> Schedule:
        """Return the schedule shortened or extended to another duration."""
        if not (np.isfinite(duration_s) and duration_s > 0.0):
            raise InputError(f"duration_s is {duration_s:g}; give a finite value above 0")
        if duration_s > MAX_DURATION_S:
            raise InputError(f"duration_s is {duration_s:g}; give at most {MAX_DURATION_S:g} s")
        return replace(self, duration_s=duration_s)

    def sampled(self, rate_Hz: float, radius_m: float) -> SampledSchedule:
        """Return the commands at every control tick.

        Raises:
            InputError: too long, or a track exceeds `MAX_LEVEL`.
        """
        if self.duration_s > MAX_DURATION_S:
            raise InputError(
                f"duration_s of schedule {self.name!r} is {self.duration_s:g}; give at most "
                f"{MAX_DURATION_S:g} s"
            )
        ticks = max(1, round(self.duration_s * rate_Hz))
        t = np.arange(ticks) / rate_Hz
        plate_z, share = np.full(ticks, PARKED_M), np.zeros(ticks)
        for visit in self.plate:
            fraction = visit.share(t)
            plate_z = np.where(fraction > 0.0, visit.z_over_R * radius_m, plate_z)
            share = np.maximum(share, fraction)
        observer, feedforward = np.ones(ticks), np.ones(ticks)
        for switch in self.switches:
            later = t >= switch.at_s - 1e-9
            if switch.observer is not None:
                observer[later] = float(switch.observer)
            if switch.feedforward is not None:
                feedforward[later] = float(switch.feedforward)
        return SampledSchedule(
            rate_Hz=rate_Hz,
            time_s=t,
            reference_rad=np.radians(self._track("reference_deg", 0.0, t)),
            collective=self._track("collective", 1.0, t),
            dither_us=self._track("dither_us", 0.0, t),
            plate_z_m=plate_z,
            plate_share=share,
            observer=observer,
            feedforward=feedforward,
        )

    def _track(self, track: str, level: float, time_s: Array) -> Array:
        """Return the sum of a level and the signals of a track (m,)."""
        values = np.zeros(time_s.shape)
        for signal in getattr(self, track):
            values += signal.sampled(time_s, self.duration_s)
        values += level
        low, high = MAX_LEVEL[track]
        worst = float(values[np.argmax(np.maximum(values - high, low - values))])
        if not low <= worst <= high:
            raise InputError(
                f"{track} of schedule {self.name!r} is {worst:g}; allowed: {low:g} to {high:g}"
            )
        return values


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SampledSchedule:
    """Commands of a run at every control tick, (m,) each.

    Attributes:
        collective: in units of hover thrust.
        plate_z_m: distance at level beam; `PARKED_M` between visits.
        observer, feedforward: 1 while that part of the controller is on.
    """

    rate_Hz: float
    time_s: Array
    reference_rad: Array
    collective: Array
    dither_us: Array
    plate_z_m: Array
    plate_share: Array
    observer: Array
    feedforward: Array

    def __len__(self) -> int:
        return len(self.time_s)


def _index(time_s: Array, every_s: float, count: int) -> NDArray[np.intp]:
    index: NDArray[np.intp] = np.clip((time_s / every_s + 1e-9).astype(np.intp), 0, count - 1)
    return index


def due_ticks(first_tick: int, ticks: int, rate_Hz: float, stream_Hz: float) -> NDArray[np.bool_]:
    """Return a mask of the stream ticks with a new reading of a sensor (ticks,).

    Tick k has the conversion that ended in (k - 1, k] / stream_Hz. A sensor as fast as the stream,
    or of rate 0, has one at every tick.
    """
    if not rate_Hz or rate_Hz >= stream_Hz:
        return np.ones(ticks, bool)
    # The small offset assigns a conversion that ends exactly on a tick to that tick.
    edges = np.arange(first_tick - 1, first_tick + ticks, dtype=float) * (rate_Hz / stream_Hz)
    whole = np.floor(edges + 1e-9)
    fresh: NDArray[np.bool_] = whole[1:] > whole[:-1]
    return fresh


def load_schedule(name_or_path: str | Path) -> Schedule:
    """Return a bundled schedule by name, or a user-defined one by the path of its TOML file."""
    return read_strict(Schedule, *read_library_file("schedule", "schedules", name_or_path))


def schedule_to_toml(schedule: Schedule) -> str:
    """Return a schedule as TOML text; parsing it gives the same schedule."""
    return tomli_w.dumps(_non_default_values(schedule))


def _non_default_values(item: Any) -> dict[str, Any]:
    """Return a table of the values that differ from their defaults; nested parts become tables."""
    table: dict[str, Any] = {}
    for field in fields(item):
        value = getattr(item, field.name)
        if value == field.default:
            continue
        if isinstance(value, tuple):
            value = [_non_default_values(part) if is_dataclass(part) else part for part in value]
        table[field.name] = value
    return table
