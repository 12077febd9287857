"""Run the pitch bench in closed loop: one run, many at once, or tick by tick."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import InputError
from benchtool.core.schedule import SampledSchedule
from benchtool.physics.model import Model
from benchtool.simulate.controllers.pitch import Feedforward, PitchControl
from benchtool.simulate.gathered import gathered
from benchtool.simulate.noise import lane_states
from benchtool.simulate.pitch import rows as r
from benchtool.simulate.pitch.bench import SENSOR_NAMES, PitchBench, PitchSensor
from benchtool.simulate.pitch.hooks import pitch_module
from benchtool.simulate.pitch.pack import geometry_of, loop_effects, pack
from benchtool.simulate.sensor import due

Array = NDArray[np.float64]

PAST = 64
"""Control ticks that delayed sensors may look back."""


@dataclass(frozen=True, slots=True, eq=False)
class PitchJob:
    """Hold what one lane simulates: a bench, its controller, and what that takes for true."""

    bench: PitchBench
    control: PitchControl
    believed: Model | None = None

    @property
    def belief(self) -> Model:
        """The model that feedforward and mixer use: the bench's own unless another is given."""
        return self.believed if self.believed is not None else self.bench.model


def shared_key(job: PitchJob) -> tuple[object, ...]:
    """Return what lanes of one loop must have in common, as something that can be compared."""
    bench, control = job.bench, job.control
    known = control.feedforward
    sensors = [bench.sensors.get(name, PitchSensor()) for name in SENSOR_NAMES]
    model = bench.model
    return (
        model.rig.name,
        model.wake_rule,
        model.body_distance,
        bench.plant_rate_Hz,
        bench.hover_N,
        control.observer,
        (known.strength > 0.0, known.height_error_m, known.late_s),
        tuple((sensor.rate_Hz, sensor.delay_s) for sensor in sensors),
    )


def log_rows(n_discs: int) -> NDArray[np.int64]:
    """Return the rows of the work space that a run logs, in the order of `PitchLog`."""
    scalars = [
        r.REFERENCE, r.READ_THETA, r.READ_GYRO, r.PLATE, r.READ_PLATE, r.SHARE, r.TORQUE,
        r.ESTIMATE, r.THETA, r.RATE,
    ]  # fmt: skip
    discs = range(n_discs)
    rows = scalars + [r.PWM + i for i in discs] + [r.READ_SPEED + i for i in discs]
    return np.array(rows, np.int64)


def track_rows(n_discs: int) -> NDArray[np.int64]:
    """Return the rows that following a log gives: predicted readings, then the state."""
    discs = range(n_discs)
    rows = [r.READ_THETA, r.READ_GYRO, r.THETA, r.RATE, r.WAKE]
    rows += [r.READ_SPEED + i for i in discs] + [r.SPEED + i for i in discs]
    return np.array(rows, np.int64)


class PitchLoop:
    """Hold everything a compiled loop needs for a few lanes that share schedule and structure.

    Args:
        jobs: one per lane.
        schedule: commands, the same for all.
        seed, runs: of the noise; the number of each lane's run under the seed.
        external: the controller is the caller's, tick by tick.
        neutral_too: spell out effects that cannot act too, see `loop_effects`.
        log: (n_ticks, n_rows, n_lanes) to log into; a new one when None or of another shape.
    """

    def __init__(
        self,
        jobs: Sequence[PitchJob],
        schedule: SampledSchedule,
        seed: int,
        runs: Sequence[int],
        *,
        external: bool = False,
        neutral_too: bool = False,
        log: Array | None = None,
    ) -> None:
        first = jobs[0]
        for other in {id(job): job for job in jobs}.values():
            if other is not first and shared_key(other) != shared_key(first):
                raise InputError(
                    "runs side by side must share rig, rates, delays, and what observer and "
                    "feedforward know; simulate the others apart"
                )
        bench, model = first.bench, first.bench.model
        self.lanes, self.schedule = len(jobs), schedule
        self.n_discs = model.rig.n_discs
        models = [model for job in jobs for model in (job.bench.model, job.belief)]
        effects = loop_effects(*models, neutral_too=neutral_too)
        self._module: ModuleType = pitch_module(
            effects, self.n_discs, self.lanes, model.wake_rule, len(model.body_arms_m)
        )
        packed = {id(job): pack(job.bench, job.control, job.belief, effects) for job in jobs}
        columns = [packed[id(job)] for job in jobs]
        self.substeps = substeps_of(bench, schedule.rate_Hz)
        self.dt_s = 1.0 / bench.plant_rate_Hz
        ticks = len(schedule)
        most = max(int(column[r.DELAY_STEPS]) for column in columns)
        self.ring = most // self.substeps + 3
        self.w = np.ascontiguousarray(np.stack(columns, axis=1)).reshape(-1)
        self.states = lane_states(seed, list(runs))
        self.sent = np.zeros(self.n_discs * self.ring * self.lanes)
        self.past = np.zeros(3 * PAST * self.lanes)
        self.rows = log_rows(self.n_discs)
        shape = (ticks, len(self.rows), self.lanes)
        self.log = log if log is not None and log.shape == shape else np.empty(shape)
        control = first.control
        self.table = scheduled(schedule, control.feedforward, control.observer, bench.hover_N)
        rates_Hz = (bench.sensors.get(name, PitchSensor()).rate_Hz for name in SENSOR_NAMES)
        self.fresh = fresh_flags(tuple(rates_Hz), len(schedule), schedule.rate_Hz)
        self.geometry = geometry_of(model)
        delays = [sensor_delay(bench, name, schedule.rate_Hz) for name in SENSOR_NAMES[:3]]
        late = any(column[r.DELAY_STEPS] > 0.0 or _late(column) for column in columns)
        self.plan = np.array(
            [0, ticks, self.substeps, int(external), self.ring, int(late), PAST, *delays],
            np.int64,
        )
        self._settle(first)

    def _settle(self, job: PitchJob) -> None:
        """Begin at rest, at level, with the rotors at the first collective and sensors read."""
        at = self.lanes
        w = self.w.reshape(-1, at)
        discs = slice(0, self.n_discs)
        start = self.schedule.collective[0] * job.bench.hover_N
        for rows in (r.SPEED, r.TARGET, r.OLD, r.NEW, r.READ_SPEED):
            w[rows : rows + self.n_discs] = np.sqrt(start / w[r.K])[None, :][discs]
        self.sent.reshape(self.n_discs, self.ring, at)[:] = w[r.SPEED : r.SPEED + self.n_discs][
            :, None, :
        ]
        w[r.PLATE] = w[r.SEEN_PLATE] = w[r.READ_PLATE] = self.schedule.plate_z_m[0]
        self.past.reshape(3, PAST, at)[2] = self.schedule.plate_z_m[0]

    def run(self, first: int = 0, last: int | None = None) -> None:
        """Run control ticks from `first` up to `last`."""
        self.plan[0] = first
        self.plan[1] = len(self.schedule) if last is None else last
        self._module.run(
            self.w, self.states, self.sent, self.past, self.log, self.rows, self.table,
            self.fresh, *self.geometry, self.plan, self.dt_s,
        )  # fmt: skip

    def drive(self, pwm_us: Array) -> None:
        """Take the pulses (n_discs, n_ticks) from a log; no controller runs."""
        self.table = np.vstack([self.table, pwm_us])
        self.plan[3] = 2

    def follow(
        self, seen: Array, gains: Array, first_tick: int = 0, span: tuple[int, int] | None = None
    ) -> Array:
        """Follow a log and return its rows (n_ticks, n_rows, n_lanes), see `track_rows`.

        Args:
            seen: (3 + n_discs, n_ticks) what was read, see `pitch_track`.
            gains: (7,) of the filter.
            first_tick: how many ticks of the experiment lie before the log's first row.
            span: the first row to follow, and the one to stop before; the whole log when None.
        """
        first, last = span if span is not None else (0, len(self.schedule))
        self.plan[0], self.plan[1] = first, last
        rows = track_rows(self.n_discs)
        log = np.empty((len(self.schedule), len(rows), self.lanes))
        self._module.track(
            self.w, self.states, self.sent, log, rows, self.table, seen, gains, *self.geometry,
            self.plan, self.dt_s, first_tick,
        )  # fmt: skip
        return log[first:last] if span is None else np.array(log[first:last])

    def stepper(self) -> Callable[[int], None]:
        """Return a function that runs one control tick, as quickly as it can be called.

        The loop's arrays become views into one block: take them from the loop afterwards.
        """
        block, where, views = gathered(
            [
                self.w, self.states, self.sent, self.past, self.log, self.rows, self.table,
                self.fresh.astype(float), *self.geometry, np.array([self.dt_s]),
            ]
        )  # fmt: skip
        self.w, self.states, self.sent, self.past, self.log, _, self.table = views[:7]
        return partial(self._module.tick, block, where, self.plan)

    def row(self, row: int) -> Array:
        """Return one row of the work space (n_lanes,)."""
        values: Array = self.w.reshape(-1, self.lanes)[row]
        return values


def substeps_of(bench: PitchBench, rate_Hz: float) -> int:
    """Return plant steps per control tick, or refuse rates that do not divide."""
    ratio = bench.plant_rate_Hz / rate_Hz
    whole = round(ratio)
    if whole < 1 or abs(ratio - whole) > 1e-9 * ratio:
        raise InputError(
            f"the plant runs at {bench.plant_rate_Hz:g} Hz, the controller at {rate_Hz:g} Hz; "
            f"take a plant_rate_Hz that is a whole multiple of the control rate"
        )
    return whole


@lru_cache(maxsize=4)
def scheduled(
    schedule: SampledSchedule, known: Feedforward, observing: bool, hover_N: float
) -> Array:
    """Return the schedule as the loop takes it (9, n_ticks)."""
    shift = round(known.late_s * schedule.rate_Hz)
    source = np.clip(np.arange(len(schedule)) - shift, 0, len(schedule) - 1)
    table = np.empty((r.SCHEDULE_ROWS, len(schedule)))
    table[r.S_REFERENCE] = schedule.reference_rad
    table[r.S_COLLECTIVE] = schedule.collective * hover_N
    table[r.S_PLATE] = schedule.plate_z_m
    table[r.S_SHARE] = schedule.plate_share
    table[r.S_BELIEVED_PLATE] = schedule.plate_z_m[source] + known.height_error_m
    table[r.S_BELIEVED_SHARE] = schedule.plate_share[source]
    table[r.S_OBSERVER] = schedule.observer * float(observing)
    table[r.S_FEEDFORWARD] = schedule.feedforward * float(known.strength > 0.0)
    table[r.S_DITHER] = schedule.dither_us
    return table


@lru_cache(maxsize=4)
def fresh_flags(rates_Hz: tuple[float, ...], ticks: int, control_Hz: float) -> NDArray[np.uint8]:
    """Return which sensor has a new reading at which tick (n_ticks + 1, n_sensors)."""
    flags = [due(0, ticks + 1, rate_Hz, control_Hz) for rate_Hz in rates_Hz]
    return np.ascontiguousarray(np.column_stack(flags).astype(np.uint8))


def sensor_delay(bench: PitchBench, name: str, rate_Hz: float) -> int:
    """Return a sensor's delay in control ticks."""
    delay_s = bench.sensors.get(name, PitchSensor()).delay_s
    ticks = round(delay_s * rate_Hz)
    if ticks >= PAST:
        raise InputError(
            f"{name}.delay_s is {delay_s:g} s, above {(PAST - 1) / rate_Hz:g} s; lower it"
        )
    return ticks


def _late(column: Array) -> bool:
    """Whether some of a step still runs on the command before."""
    return bool(column[r.MID_OLD] > 0.0 or column[r.END_OLD] > 0.0)
