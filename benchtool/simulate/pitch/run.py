"""Closed loop of the pitch bench: single runs, parallel lanes, or tick by tick."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.schedule import SampledSchedule, due_ticks
from benchtool.core.units import Array
from benchtool.physics.disc_thrust import ImageRules
from benchtool.physics.effects.effect import Effect
from benchtool.physics.expression import flat_values
from benchtool.physics.model import Model
from benchtool.simulate.controllers.controller import PitchPlant
from benchtool.simulate.controllers.pitch import Feedforward, PitchControl
from benchtool.simulate.hooks import loop_effects, loop_numbers
from benchtool.simulate.kernel import BUILT_IN, CALLER, PULSES, LoopPlan
from benchtool.simulate.layout import Layout, lend_rows, rows_in, zero_record
from benchtool.simulate.motors import build_motion
from benchtool.simulate.noise import lane_states
from benchtool.simulate.pitch import records as r
from benchtool.simulate.pitch.bench import GRAVITY_M_S2, SENSOR_NAMES, PitchBench, PitchSensor
from benchtool.simulate.pitch.filter_ticks import FilterGains
from benchtool.simulate.pitch.loops import PitchLoops, pitch_loops
from benchtool.simulate.pitch.result import LOGGED

MAX_DISCS = 8  # of a loop: more would take minutes to compile


def build_image_rules(model: Model) -> ImageRules:
    """Return the image rules of a model for a plate that tilts only about the hinge."""
    x_m, _, arm_m = (part.tolist() for part in model.body_images)
    sources = list(zip(x_m, arm_m, strict=True))
    return model.image_rules._replace(body_like=tuple(map(sources.index, sources)))


def build_geometry(model: Model, dt_s: float) -> Array:
    """Return a `Geometry` as a flat array."""
    rig = model.rig
    x_m, y_m = rig.disc_positions_m[:, 0], rig.disc_positions_m[:, 1]
    counts = np.bincount(rig.disc_of_rotor, minlength=rig.n_discs)
    if rig.n_discs > MAX_DISCS:
        raise InputError(f"rig {rig.name!r} has {rig.n_discs} discs; maximum: {MAX_DISCS}")
    if not np.any(x_m):
        raise InputError(
            f"rig {rig.name!r} has no rotor before or behind the hinge; use another rig"
        )
    roots = np.sqrt(counts)
    span_m2 = sum(root * root * x * x for root, x in zip(roots, x_m, strict=True))
    parts = [*(dt_s, span_m2, x_m, y_m, roots, rig.disc_distances_m), *model.body_images]
    return np.concatenate([np.ravel(part) for part in parts])


def build_lane_records(
    bench: PitchBench,
    control: PitchControl,
    nominal: Model,
    effects: Sequence[Effect],
    layout: Layout,
) -> Array:
    """Return the records of one lane (n_rows,)."""
    model, dt_s = bench.model, 1.0 / bench.plant_rate_Hz
    zeros = (0.0,) * model.rig.n_discs
    values, sensors = model.parameters, bench.sensors
    sensor_errors = [
        r.SensorErrors(sensor.noise, sensor.bias, sensor.quantum)
        for sensor in (sensors.get(name, PitchSensor()) for name in SENSOR_NAMES)
    ]
    inertia_kgm2 = nominal.rig.body.inertia_yy_kgm2
    plant = PitchPlant(inertia_kgm2, torque_limit_Nm(bench, nominal))
    return layout.column(
        command=r.Command(0.0, 0.0, tuple(1.0 for _ in zeros), zeros),
        body=r.HingedBody(
            dt_s / bench.inertia_kgm2, model.rig.body.mass_kg * GRAVITY_M_S2, values["k"].value,
            values["R_m"].value, bench.stop_rad, tuple(bench.covered),
        ),
        pulses=_pulse_map(model),
        limits=r.PulseLimits(bench.pwm_min_us, bench.pwm_max_us, bench.pwm_quantum_us),
        motion=build_motion(model, dt_s),
        sensors=r.Sensors(*sensor_errors),
        nominal=r.Nominal(
            nominal.parameters["k"].value, nominal.parameters["R_m"].value, _pulse_map(nominal),
            control.feedforward.strength,
        ),
        law=control.law.numbers(control, plant),
        effects=loop_numbers(model, effects),
        nominal_effects=loop_numbers(nominal, effects),
    )  # fmt: skip


def _pulse_map(model: Model) -> r.PulseMap:
    propulsion = model.rig.propulsion
    return r.PulseMap(propulsion.speed_per_us_rad_s, propulsion.pwm_start_us)


def torque_limit_Nm(bench: PitchBench, nominal: Model) -> float:
    """Return the largest torque about hover before a rotor stops or saturates."""
    rig = nominal.rig
    p = rig.propulsion
    x_m = rig.disc_positions_m[rig.disc_of_rotor, 0]
    max_thrust_N = (
        nominal.parameters["k"].value
        * (p.speed_per_us_rad_s * (bench.pwm_max_us - p.pwm_start_us)) ** 2
    )
    margin_N = min(bench.hover_N, max(max_thrust_N - bench.hover_N, 0.0))
    return float(margin_N * np.sum(x_m * x_m) / np.max(np.abs(x_m)))


@dataclass(frozen=True, slots=True, eq=False)
class PitchJob:
    """Job of one lane: bench, controller and nominal model."""

    bench: PitchBench
    control: PitchControl
    nominal: Model | None = None

    @property
    def nominal_model(self) -> Model:
        """Model for feedforward and mixer, that of the bench by default."""
        return self.nominal if self.nominal is not None else self.bench.model


def shared_key(job: PitchJob) -> tuple[object, ...]:
    """Return the comparable properties that all lanes of a loop share."""
    bench, control = job.bench, job.control
    feedforward = control.feedforward
    sensors = [bench.sensors.get(name, PitchSensor()) for name in SENSOR_NAMES]
    model = bench.model
    return (
        model.rig.name,
        model.image_rules,
        model.body_distance,
        bench.plant_rate_Hz,
        bench.hover_N,
        control.law.name,
        control.observer,
        (feedforward.strength > 0.0, feedforward.height_error_m, feedforward.late_s),
        tuple((sensor.rate_Hz, sensor.delay_s) for sensor in sensors),
    )


FILTERED = (  # record fields from a filter, in the order of `Predictions`
    "readings.theta_rad", "readings.gyro_rad_s", "hinge.theta_rad", "hinge.rate_rad_s",
    "hinge.wake_Nm", "hinge.deflection", "readings.speed_rad_s", "rotors.speed_rad_s",
)  # fmt: skip


class PitchLoop:
    """Compiled loop with its arrays, for lanes that share schedule and structure.

    Args:
        seed, runs: of the noise; run number of each lane.
        external: the caller is the controller, tick by tick.
        neutral_too: compile inactive effects, too; see `loop_effects`.
        log: (n_ticks, n_rows, n_lanes) to reuse; a new one is allocated if the shape differs.
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
        first, distinct_jobs = jobs[0], tuple(dict.fromkeys(jobs))
        bench, control = first.bench, first.control
        self.lanes, self.schedule = len(jobs), schedule
        self.n_discs = bench.model.rig.n_discs
        prepared = prepare_loop(distinct_jobs, self.lanes, neutral_too)
        self.layout, self.loops, self.geometry, columns_by_job = prepared
        columns = [columns_by_job[job] for job in jobs]
        self.substeps = count_substeps(bench, schedule.rate_Hz)
        ticks = len(schedule)
        delays = np.concatenate(
            [column[self.layout.rows("motion.delay_steps")] for column in columns]
        )
        self.ring = int(delays.max()) // self.substeps + 3
        self.w = np.stack(columns, axis=1).reshape(-1)
        self.states = lane_states(seed, runs)
        self.sent = np.zeros((self.n_discs, self.ring, self.lanes))
        self.past = np.zeros((3, r.PAST, self.lanes))
        self.rows = self.layout.row_numbers(LOGGED)
        shape = (ticks, len(self.rows), self.lanes)
        self.log = log if log is not None and log.shape == shape else np.empty(shape)
        self.table = schedule_rows(
            schedule, control.feedforward, control.observer, bench.hover_N, self.n_discs
        )
        rates_Hz = (bench.sensors.get(name, PitchSensor()).rate_Hz for name in SENSOR_NAMES)
        self.fresh = fresh_flags(tuple(rates_Hz), len(schedule), schedule.rate_Hz)
        sensor_delays = [sensor_delay(bench, name, schedule.rate_Hz) for name in SENSOR_NAMES[:3]]
        old_command_weights = [self.view(f"motion.{half}")[1] for half in ("first", "second")]
        is_delayed = delays.any() or np.any(old_command_weights)
        driver = CALLER if external else BUILT_IN
        plan = LoopPlan(self.substeps, driver, bool(is_delayed), 1, 0, 0, *sensor_delays)
        self.plan = np.array(plan, np.int64)
        self._set_initial_state(first)

    def _set_initial_state(self, job: PitchJob) -> None:
        """Set the initial state: at rest, level, rotors at the first collective, sensors read."""
        start_N = self.schedule.collective[0] * job.bench.hover_N
        speed_rad_s = np.sqrt(start_N / self.view("body.k"))
        self.set_speeds(speed_rad_s)
        self.view("readings.speed_rad_s")[:] = speed_rad_s
        for field in ("setpoint.plate_z_m", "delayed.plate_z_m", "readings.plate_z_m"):
            self.view(field)[:] = self.schedule.plate_z_m[0]
        self.past[2] = self.schedule.plate_z_m[0]

    def view(self, field: str) -> Array:
        """Return a view of a record or field, for example "hinge.theta_rad" (n, n_lanes)."""
        return self.w.reshape(-1, self.lanes)[self.layout.rows(field)]

    def schedule_view(self, field: str) -> Array:
        """Return a view of a field of `Tick` in the schedule (n, n_ticks)."""
        return self.table[rows_in(r.tick_slot(self.n_discs), field)]

    def set_speeds(self, speed_rad_s: Array | float) -> None:
        """Set the speed of every rotor (n_discs, n_lanes), also in the delay."""
        for field in ("rotors.speed", "targets.sent", "targets.old", "targets.new"):
            self.view(f"{field}_rad_s")[:] = speed_rad_s
        self.sent[:] = self.view("rotors.speed_rad_s")[:, None, :]

    def run(self, first: int = 0, last: int | None = None) -> None:
        """Run control ticks from `first` to `last` (exclusive)."""
        arrays, run = self.arrays(), self.loops.run
        run(lend_rows(run, arrays), self.plan, first, len(self.schedule) if last is None else last)

    def arrays(self) -> r.PitchArrays:
        """Return the arrays of the loop."""
        return r.PitchArrays(
            self.w, self.states, self.sent, self.past, self.log, self.rows, self.table, self.fresh,
            self.geometry, np.zeros(len(FilterGains._fields)),
        )  # fmt: skip

    def set_driver(self, driver: int) -> None:
        """Set the source of commands: `BUILT_IN`, `CALLER` or `PULSES`."""
        self.plan[LoopPlan._fields.index("driver")] = driver

    def drive(self, pwm_us: Array) -> None:
        """Use logged pulse widths (n_discs, n_ticks) instead of a controller."""
        self.table = self.table.copy()
        self.schedule_view("pwm_us")[:] = pwm_us
        self.set_driver(PULSES)

    def filter(self, log: Array, gains: Array, before: int, span: tuple[int, int, int]) -> Array:
        """Filter along a log and return the rows `FILTERED` (n_ticks, n_rows, n_lanes).

        Args:
            log: (n_numbers, n_ticks), a `filter_ticks.LoggedTick` per column.
            before: number of ticks of the experiment before the first row of the log.
            span: first row of the commands (earlier than the filter, for the delay), first row of
                the filter, and end (exclusive).
        """
        rows = self.layout.row_numbers(FILTERED)
        filtered = np.empty((len(self.schedule), len(rows), self.lanes))
        arrays = self.arrays()._replace(log=filtered, logged=rows, schedule=log, gains=gains)
        run = self.loops.filter
        for is_at_rest, first, last in ((1, *span[:2]), (0, *span[1:])):
            plan = LoopPlan(*self.plan)._replace(driver=BUILT_IN)
            plan = plan._replace(ticks_before=before, is_at_rest=is_at_rest)
            run(lend_rows(run, arrays), np.array(plan, np.int64), first, last)
        part = filtered[slice(*span[1:])]
        return part if len(part) == len(filtered) else part.copy()

    def stepper(self) -> Callable[[int, int], None]:
        """Return a function that runs control ticks with minimal overhead.

        Arguments: first tick and end (exclusive). It uses the present arrays of the loop: change
        them only in place.
        """
        self._stepped = self.arrays()
        return partial(self.loops.run, lend_rows(self.loops.run, self._stepped), self.plan)


@lru_cache(maxsize=64)
def prepare_loop(
    jobs: tuple[PitchJob, ...], lanes: int, neutral_too: bool
) -> tuple[Layout, PitchLoops, Array, dict[PitchJob, Array]]:
    """Return layout, loops, geometry, and the records of each job (cached)."""
    first, key = jobs[0], shared_key(jobs[0])
    if any(shared_key(other) != key for other in jobs[1:]):
        raise InputError(
            "lanes of a loop must share rig, rates, delays, and settings of observer and "
            "feedforward; simulate the others separately"
        )
    bench, model, law = first.bench, first.bench.model, first.control.law
    models = [item for job in jobs for item in (job.bench.model, job.nominal_model)]
    effects = loop_effects(*models, neutral_too=neutral_too)
    n_discs, n_numbers = model.rig.n_discs, sum(len(effect.parameters) for effect in effects)
    law_example = zero_record(law.numbers(first.control, PitchPlant(1.0, 1.0)))
    layout = r.build_layout(n_discs, n_numbers, law_example, law.state)
    loops = pitch_loops(effects, layout, n_discs, lanes, build_image_rules(model), law)
    columns = {
        job: build_lane_records(job.bench, job.control, job.nominal_model, effects, layout)
        for job in jobs
    }
    return layout, loops, build_geometry(model, 1.0 / bench.plant_rate_Hz), columns


def count_substeps(bench: PitchBench, rate_Hz: float) -> int:
    """Return the number of plant steps per control tick; raise if it is not an integer."""
    ratio = bench.plant_rate_Hz / rate_Hz
    whole = round(ratio)
    if whole < 1 or abs(ratio - whole) > 1e-9 * ratio:
        raise InputError(
            f"the plant runs at {bench.plant_rate_Hz:g} Hz, the controller at {rate_Hz:g} Hz; "
            f"use a plant_rate_Hz that is an integer multiple of the control rate"
        )
    return whole


@lru_cache(maxsize=4)
def schedule_rows(
    schedule: SampledSchedule,
    map_settings: Feedforward,
    has_observer: bool,
    hover_N: float,
    n_discs: int,
) -> Array:
    """Return the schedule of a loop, a `Tick` per column (n_rows, n_ticks)."""
    delay_ticks = round(map_settings.late_s * schedule.rate_Hz)
    map_rows = np.clip(np.arange(len(schedule)) - delay_ticks, 0, len(schedule) - 1)
    zeros = np.zeros(len(schedule))
    tick = r.Tick(
        r.Setpoint(
            schedule.reference_rad, schedule.collective * hover_N, schedule.plate_z_m,
            schedule.plate_share,
        ),
        nominal_plate_z_m=schedule.plate_z_m[map_rows] + map_settings.height_error_m,
        nominal_share=schedule.plate_share[map_rows],
        observer=schedule.observer * float(has_observer),
        feedforward=schedule.feedforward * float(map_settings.strength > 0.0),
        dither_us=schedule.dither_us,
        pwm_us=(zeros,) * n_discs,
    )  # fmt: skip
    return np.array(flat_values(tick), float)


@lru_cache(maxsize=4)
def fresh_flags(rates_Hz: tuple[float, ...], ticks: int, control_Hz: float) -> Array:
    """Return flags of new readings (n_sensors, n_ticks + 1)."""
    flags = [due_ticks(0, ticks + 1, rate_Hz, control_Hz) for rate_Hz in rates_Hz]
    return np.stack(flags).astype(float)


def sensor_delay(bench: PitchBench, name: str, rate_Hz: float) -> int:
    """Return the delay of a sensor in control ticks."""
    delay_s = bench.sensors.get(name, PitchSensor()).delay_s
    ticks = round(delay_s * rate_Hz)
    if ticks >= r.PAST:
        raise InputError(
            f"{name}.delay_s is {delay_s:g} s; allowed: up to {(r.PAST - 1) / rate_Hz:g} s"
        )
    return ticks
