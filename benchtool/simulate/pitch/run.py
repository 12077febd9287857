"""Run the pitch bench in closed loop: one run, many at once, or tick by tick."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.errors import InputError
from benchtool.core.schedule import SampledSchedule, due_ticks
from benchtool.physics.disc_thrust import ImageRules
from benchtool.physics.effects.effect import Effect
from benchtool.physics.expression import flat_values
from benchtool.physics.model import Model
from benchtool.simulate.controllers.controller import PitchPlant
from benchtool.simulate.controllers.pitch import Feedforward, PitchControl
from benchtool.simulate.hooks import loop_effects, loop_numbers
from benchtool.simulate.kernel import BUILT_IN, CALLER, PULSES, LoopPlan
from benchtool.simulate.layout import Layout, allocate, lend_rows, rows_in
from benchtool.simulate.motors import motion_of
from benchtool.simulate.noise import lane_states
from benchtool.simulate.pitch import records as r
from benchtool.simulate.pitch.bench import GRAVITY_M_S2, SENSOR_NAMES, PitchBench, PitchSensor
from benchtool.simulate.pitch.filter_ticks import FilterGains
from benchtool.simulate.pitch.loops import PitchLoops, pitch_loops
from benchtool.simulate.pitch.result import LOGGED

MAX_DISCS = 8  # what a loop takes: beyond, it compiles for minutes


def rules_of(model: Model) -> ImageRules:
    """Return a model's rules of images for a plate that leans about the hinge alone."""
    x_m, _, arm_m = (part.tolist() for part in model.body_images)
    places = list(zip(x_m, arm_m, strict=True))
    return model.image_rules._replace(body_like=tuple(map(places.index, places)))


def geometry_of(model: Model, dt_s: float) -> Array:
    """Return plant step, places and distances as the loop takes them, see `Geometry`."""
    rig = model.rig
    places = rig.disc_positions_m
    counts = np.bincount(rig.disc_of_rotor, minlength=rig.n_discs)
    if rig.n_discs > MAX_DISCS:
        raise InputError(f"rig {rig.name!r} has {rig.n_discs} discs; the loop takes up to 8")
    if not np.any(places[:, 0]):
        raise InputError(
            f"rig {rig.name!r} has no rotor before or behind the hinge; take another rig"
        )
    roots = np.sqrt(counts)
    span_m2 = sum(root * root * x * x for root, x in zip(roots, places[:, 0], strict=True))
    parts = [
        *(dt_s, span_m2, places[:, 0], places[:, 1], roots, rig.disc_distances_m),
        *model.body_images,
    ]
    return np.concatenate([np.ravel(part) for part in parts])


def pack(
    bench: PitchBench,
    control: PitchControl,
    nominal: Model,
    effects: Sequence[Effect],
    layout: Layout,
) -> Array:
    """Return one lane's column of the work space (n_rows,)."""
    model, dt_s = bench.model, 1.0 / bench.plant_rate_Hz
    discs = (0.0,) * model.rig.n_discs
    values, sensors = model.parameters, bench.sensors
    shown = [
        r.SensorErrors(sensor.noise, sensor.bias, sensor.quantum)
        for sensor in (sensors.get(name, PitchSensor()) for name in SENSOR_NAMES)
    ]
    inertia_kgm2 = nominal.rig.body.inertia_yy_kgm2
    plant = PitchPlant(inertia_kgm2, torque_limit_Nm(bench, nominal))
    return layout.column(
        command=r.Command(0.0, 0.0, tuple(1.0 for _ in discs), discs),
        body=r.HingedBody(
            dt_s / bench.inertia_kgm2, model.rig.body.mass_kg * GRAVITY_M_S2, values["k"].value,
            values["R_m"].value, bench.stop_rad, tuple(bench.covered),
        ),
        pulses=_pulse_map(model),
        limits=r.PulseLimits(bench.pwm_min_us, bench.pwm_max_us, bench.pwm_quantum_us),
        motion=motion_of(model, dt_s),
        sensors=r.Sensors(*shown),
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
    """Return the torque that the mixer can give about hover before a rotor stops or saturates."""
    rig = nominal.rig
    p = rig.propulsion
    x = rig.disc_positions_m[rig.disc_of_rotor, 0]
    top = (
        nominal.parameters["k"].value
        * (p.speed_per_us_rad_s * (bench.pwm_max_us - p.pwm_start_us)) ** 2
    )
    room = min(bench.hover_N, max(top - bench.hover_N, 0.0))
    return float(room * np.sum(x * x) / np.max(np.abs(x)))


@dataclass(frozen=True, slots=True, eq=False)
class PitchJob:
    """Hold what one lane simulates: a bench, its controller, and what that takes for true."""

    bench: PitchBench
    control: PitchControl
    nominal: Model | None = None

    @property
    def nominal_model(self) -> Model:
        """The model that feedforward and mixer use: the bench's own unless another is given."""
        return self.nominal if self.nominal is not None else self.bench.model


def shared_key(job: PitchJob) -> tuple[object, ...]:
    """Return what lanes of one loop must have in common, as something that can be compared."""
    bench, control = job.bench, job.control
    known = control.feedforward
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
        (known.strength > 0.0, known.height_error_m, known.late_s),
        tuple((sensor.rate_Hz, sensor.delay_s) for sensor in sensors),
    )


FILTERED = (
    "readings.theta_rad", "readings.gyro_rad_s", "hinge.theta_rad", "hinge.rate_rad_s",
    "hinge.wake_Nm", "hinge.bent", "readings.speed_rad_s", "rotors.speed_rad_s",
)  # fmt: skip
"""Records' fields that filtering a log gives, in the order of `Predictions`."""


class PitchLoop:
    """Hold everything a compiled loop needs for a few lanes that share schedule and structure.

    Args:
        seed, runs: of the noise; the number of each lane's run under the seed.
        external: the controller is the caller's, tick by tick.
        neutral_too: compile effects that cannot act too, see `loop_effects`.
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
        first, each = jobs[0], tuple(dict.fromkeys(jobs))
        bench, control = first.bench, first.control
        self.lanes, self.schedule = len(jobs), schedule
        self.n_discs = bench.model.rig.n_discs
        self.layout, self.loops, self.geometry, packed = prepare_loop(each, self.lanes, neutral_too)
        columns = [packed[job] for job in jobs]
        self.substeps = substeps_of(bench, schedule.rate_Hz)
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
        late = [sensor_delay(bench, name, schedule.rate_Hz) for name in SENSOR_NAMES[:3]]
        on_old = [self.view(f"motion.{half}")[1] for half in ("first", "second")]
        delayed = delays.any() or np.any(on_old)
        driver = CALLER if external else BUILT_IN
        plan = LoopPlan(self.substeps, driver, bool(delayed), 1, 0, 0, *late)
        self.plan = np.array(plan, np.int64)
        self._settle(first)

    def _settle(self, job: PitchJob) -> None:
        """Begin at rest, at level, with the rotors at the first collective and sensors read."""
        start_N = self.schedule.collective[0] * job.bench.hover_N
        speed_rad_s = np.sqrt(start_N / self.view("body.k"))
        self.set_speeds(speed_rad_s)
        self.view("readings.speed_rad_s")[:] = speed_rad_s
        for field in ("setpoint.plate_z_m", "delayed.plate_z_m", "readings.plate_z_m"):
            self.view(field)[:] = self.schedule.plate_z_m[0]
        self.past[2] = self.schedule.plate_z_m[0]

    def view(self, field: str) -> Array:
        """Return a record or its field, as "hinge.theta_rad", to read or write (n, n_lanes)."""
        return self.w.reshape(-1, self.lanes)[self.layout.rows(field)]

    def planned(self, field: str) -> Array:
        """Return a field of the schedule's `Tick`, to read or write (n, n_ticks)."""
        return self.table[rows_in(r.tick_slot(self.n_discs), field)]

    def set_speeds(self, speed_rad_s: Array | float) -> None:
        """Give every rotor these speeds (n_discs, n_lanes), with no other on its way."""
        for field in ("rotors.speed", "targets.sent", "targets.old", "targets.new"):
            self.view(f"{field}_rad_s")[:] = speed_rad_s
        self.sent[:] = self.view("rotors.speed_rad_s")[:, None, :]

    def run(self, first: int = 0, last: int | None = None) -> None:
        """Run control ticks from `first` up to `last`."""
        arrays, run = self.arrays(), self.loops.run
        run(lend_rows(run, arrays), self.plan, first, len(self.schedule) if last is None else last)

    def arrays(self) -> r.PitchArrays:
        """Return the loop's arrays."""
        return r.PitchArrays(
            self.w, self.states, self.sent, self.past, self.log, self.rows, self.table, self.fresh,
            self.geometry, np.zeros(len(FilterGains._fields)),
        )  # fmt: skip

    def set_driver(self, driver: int) -> None:
        """Set who controls: `BUILT_IN`, `CALLER` or `PULSES`."""
        self.plan[LoopPlan._fields.index("driver")] = driver

    def drive(self, pwm_us: Array) -> None:
        """Take the pulses (n_discs, n_ticks) from a log; no controller runs."""
        self.table = self.table.copy()
        self.planned("pwm_us")[:] = pwm_us
        self.set_driver(PULSES)

    def filter(self, log: Array, gains: Array, before: int, span: tuple[int, int, int]) -> Array:
        """Filter a log and return its rows (n_ticks, n_rows, n_lanes), see `FILTERED`.

        Args:
            log: (n_numbers, n_ticks), a `filter_ticks.LoggedTick` per column.
            before: how many ticks of the experiment lie before the log's first row.
            span: the row from which pulses are sent, so that a delay has them when the plant begins
                to move; the first row to filter, and the one to stop before.
        """
        rows = self.layout.row_numbers(FILTERED)
        found = np.empty((len(self.schedule), len(rows), self.lanes))
        arrays = self.arrays()._replace(log=found, logged=rows, schedule=log, gains=gains)
        run = self.loops.filter
        for held, first, last in ((1, *span[:2]), (0, *span[1:])):
            plan = LoopPlan(*self.plan)._replace(driver=BUILT_IN, before=before, held=held)
            run(lend_rows(run, arrays), np.array(plan, np.int64), first, last)
        part = found[slice(*span[1:])]
        return part if len(part) == len(found) else part.copy()

    def stepper(self) -> Callable[[int, int], None]:
        """Return a function that runs control ticks, as quickly as it can be called.

        Its arguments: the first tick, and the one to stop before. It goes on with the loop's
        present arrays: change them in place.
        """
        self._stepped = self.arrays()
        return partial(self.loops.run, lend_rows(self.loops.run, self._stepped), self.plan)


@lru_cache(maxsize=64)
def prepare_loop(
    jobs: tuple[PitchJob, ...], lanes: int, neutral_too: bool
) -> tuple[Layout, PitchLoops, Array, dict[PitchJob, Array]]:
    """Return what follows from jobs alone: layout, loops, geometry, and each job's column."""
    first, shared = jobs[0], shared_key(jobs[0])
    if any(shared_key(other) != shared for other in jobs[1:]):
        raise InputError(
            "runs side by side must share rig, rates, delays, and what observer and "
            "feedforward know; simulate the others apart"
        )
    bench, model, law = first.bench, first.bench.model, first.control.law
    models = [at for job in jobs for at in (job.bench.model, job.nominal_model)]
    effects = loop_effects(*models, neutral_too=neutral_too)
    n_discs, n_numbers = model.rig.n_discs, sum(len(effect.parameters) for effect in effects)
    like = allocate(law.numbers(first.control, PitchPlant(1.0, 1.0)))
    layout = r.layout_for(n_discs, n_numbers, like, law.state)
    loops = pitch_loops(effects, layout, n_discs, lanes, rules_of(model), law)
    columns = {
        job: pack(job.bench, job.control, job.nominal_model, effects, layout) for job in jobs
    }
    return layout, loops, geometry_of(model, 1.0 / bench.plant_rate_Hz), columns


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
def schedule_rows(
    schedule: SampledSchedule, known: Feedforward, observing: bool, hover_N: float, n_discs: int
) -> Array:
    """Return the schedule as the loop takes it, a `Tick` per column (n_rows, n_ticks)."""
    shift = round(known.late_s * schedule.rate_Hz)
    source = np.clip(np.arange(len(schedule)) - shift, 0, len(schedule) - 1)
    still = np.zeros(len(schedule))
    tick = r.Tick(
        r.Setpoint(
            schedule.reference_rad, schedule.collective * hover_N, schedule.plate_z_m,
            schedule.plate_share,
        ),
        nominal_plate_z_m=schedule.plate_z_m[source] + known.height_error_m,
        nominal_share=schedule.plate_share[source],
        observer=schedule.observer * float(observing),
        feedforward=schedule.feedforward * float(known.strength > 0.0),
        dither_us=schedule.dither_us,
        pwm_us=(still,) * n_discs,
    )  # fmt: skip
    return np.array(flat_values(tick), float)


@lru_cache(maxsize=4)
def fresh_flags(rates_Hz: tuple[float, ...], ticks: int, control_Hz: float) -> Array:
    """Return which sensor has a new reading at which tick (n_sensors, n_ticks + 1)."""
    flags = [due_ticks(0, ticks + 1, rate_Hz, control_Hz) for rate_Hz in rates_Hz]
    return np.stack(flags).astype(float)


def sensor_delay(bench: PitchBench, name: str, rate_Hz: float) -> int:
    """Return a sensor's delay in control ticks."""
    delay_s = bench.sensors.get(name, PitchSensor()).delay_s
    ticks = round(delay_s * rate_Hz)
    if ticks >= r.PAST:
        raise InputError(
            f"{name}.delay_s is {delay_s:g} s, above {(r.PAST - 1) / rate_Hz:g} s; lower it"
        )
    return ticks
