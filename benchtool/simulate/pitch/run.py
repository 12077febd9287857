"""Closed loop of the pitch bench: single runs, parallel lanes, or tick by tick."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import repeat
from math import isfinite
from struct import Struct
from typing import Any

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.schedule import SampledSchedule, due_ticks
from benchtool.core.units import Array
from benchtool.physics.body_lift import BodyImages
from benchtool.physics.effects.effect import Effect
from benchtool.physics.expression import flat_values
from benchtool.physics.model import Model
from benchtool.simulate.controllers.controller import (
    GRAVITY_M_S2,
    PitchCommand,
    PitchMeasurement,
    PitchPlant,
    PitchReference,
)
from benchtool.simulate.controllers.pitch import Feedforward, PitchControl
from benchtool.simulate.hooks import Rotors, Targets, build_motion, loop_effects, loop_numbers
from benchtool.simulate.layout import Layout, record_layout, rows_in, zero_record
from benchtool.simulate.loop import BUILT_IN, PULSES, Loop, LoopPlan, command_ring
from benchtool.simulate.noise import lane_states
from benchtool.simulate.pitch.bench import SENSOR_NAMES, PitchBench
from benchtool.simulate.pitch.lane import (
    Delayed,
    FilterGains,
    Hinge,
    HingedBody,
    PulseLimits,
    PulseMap,
    SensorErrors,
    SensorReadings,
    Sensors,
    Setpoint,
)
from benchtool.simulate.pitch.loops import (
    LOGGED,
    PAST,
    Geometry,
    PitchArrays,
    PitchLoops,
    Tick,
    pitch_loops,
    tick_slot,
)

MAX_DISCS = 8  # of a loop: more would take minutes to compile
_new = tuple.__new__  # faster than the constructors of named tuples by 0.5 us a tick
COMMAND_REMEDY = "a finite torque in N m, or a PitchCommand of finite numbers"


@dataclass(frozen=True, slots=True, eq=False)
class PitchJob:
    """Job of one lane: bench and controller."""

    bench: PitchBench
    control: PitchControl


def shared_key(job: PitchJob) -> tuple[object, ...]:
    """Return the comparable properties that all lanes of a loop share."""
    bench, control = job.bench, job.control
    feedforward = control.feedforward
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
        tuple((sensor.rate_Hz, sensor.delay_s) for sensor in bench.loop_sensors),
    )


def build_geometry(model: Model, dt_s: float) -> Geometry:
    """Return the geometry of a model for plant steps."""
    rig = model.rig
    x_m, y_m = rig.disc_positions_m.T.tolist()
    counts = np.bincount(rig.disc_of_rotor, minlength=rig.n_discs)
    if rig.n_discs > MAX_DISCS:
        raise InputError(f"rig {rig.name!r} has {rig.n_discs} discs; maximum: {MAX_DISCS}")
    if not np.any(x_m):
        raise InputError(
            f"rig {rig.name!r} has no rotor before or behind the hinge; use another rig"
        )
    roots = np.sqrt(counts).tolist()
    span_m2 = sum(root * root * x * x for root, x in zip(roots, x_m, strict=True))
    distances_m = tuple(map(tuple, rig.disc_distances_m.tolist()))
    body = BodyImages(*(tuple(part.tolist()) for part in model.body_images))
    return Geometry(dt_s, span_m2, tuple(x_m), tuple(y_m), tuple(roots), distances_m, body)


def lane_records(job: PitchJob, effects: Sequence[Effect]) -> dict[str, Any]:
    """Return the records of one lane."""
    bench, control, model = job.bench, job.control, job.bench.model
    rig, values, dt_s = model.rig, model.parameters, 1.0 / bench.plant_rate_Hz
    zeros, pulse = (0.0,) * rig.n_discs, rig.propulsion
    plant = PitchPlant(rig.body.inertia_yy_kgm2, torque_limit_Nm(bench))
    return {
        "hinge": Hinge(),
        "rotors": Rotors(zeros),
        "targets": Targets(zeros, zeros, zeros),
        "delayed": Delayed(),
        "readings": SensorReadings(0.0, 0.0, 0.0, zeros),
        "setpoint": Setpoint(),
        "command": PitchCommand(0.0, 0.0),  # for the mixer
        "factor": (1.0,) * rig.n_discs,  # of the feedforward
        "pwm_us": zeros,
        "law_state": control.law.state,
        "body": HingedBody(
            dt_s / bench.inertia_kgm2, rig.body.mass_kg * GRAVITY_M_S2, values["k"].value,
            values["R_m"].value, bench.stop_rad, tuple(bench.covered),
        ),
        "pulses": PulseMap(pulse.speed_per_us_rad_s, pulse.pwm_start_us),
        "limits": PulseLimits(bench.pwm_min_us, bench.pwm_max_us, bench.pwm_quantum_us),
        "motion": build_motion(model, dt_s),
        "sensors": Sensors(
            *(SensorErrors(one.noise, one.bias, one.quantum) for one in bench.loop_sensors)
        ),
        "strength": control.feedforward.strength,
        "law": control.law.numbers(control, plant),
        "effects": loop_numbers(model, effects),
        "nothing": 0.0,
    }  # fmt: skip


def torque_limit_Nm(bench: PitchBench) -> float:
    """Return the largest torque about hover before a rotor stops or saturates."""
    rig = bench.model.rig
    p = rig.propulsion
    x_m = rig.disc_positions_m[rig.disc_of_rotor, 0]
    max_thrust_N = (
        bench.model.parameters["k"].value
        * (p.speed_per_us_rad_s * (bench.pwm_max_us - p.pwm_start_us)) ** 2
    )
    margin_N = min(bench.hover_N, max(max_thrust_N - bench.hover_N, 0.0))
    return float(margin_N * np.sum(x_m * x_m) / np.max(np.abs(x_m)))


class PitchLoop(Loop):
    """Loop of the pitch bench, for lanes that share schedule and structure.

    Args:
        seed, runs: of the noise; run number of each lane.
        neutral_too: compile inactive effects, too; see `loop_effects`.
        log: (n_ticks, n_rows, n_lanes) to reuse; a new one is allocated if the shape differs.
    """

    loops: PitchLoops
    arrays: PitchArrays

    def __init__(
        self,
        jobs: Sequence[PitchJob],
        schedule: SampledSchedule,
        seed: int,
        runs: Sequence[int],
        *,
        neutral_too: bool = False,
        log: Array | None = None,
    ) -> None:
        bench, control = jobs[0].bench, jobs[0].control
        self.lanes, self.schedule, self.rate_Hz = len(jobs), schedule, schedule.rate_Hz
        self.n_discs = bench.model.rig.n_discs
        distinct_jobs = tuple(dict.fromkeys(jobs))
        self.layout, self.loops, geometry, columns = prepare_loop(
            distinct_jobs, self.lanes, neutral_too
        )
        w = np.stack([columns[job] for job in jobs], axis=1)
        substeps = count_substeps(bench, schedule.rate_Hz)
        ring, is_delayed = command_ring(self.layout, w, substeps)
        rows = self.layout.row_numbers(LOGGED)
        shape = (len(schedule), len(rows), self.lanes)
        self.log = log if log is not None and log.shape == shape else np.empty(shape)
        rates_Hz = tuple(sensor.rate_Hz for sensor in bench.loop_sensors)
        delays = sensor_delays(bench, schedule.rate_Hz)
        plan = LoopPlan(substeps, BUILT_IN, is_delayed, 1, 0, 0, *delays)
        arrays = PitchArrays(
            w=w.reshape(-1),
            states=lane_states(seed, runs),
            sent=np.zeros((self.n_discs, ring, self.lanes)),
            past=np.zeros((3, PAST, self.lanes)),
            log=self.log,
            logged=rows,
            schedule=schedule_rows(
                schedule, control.feedforward, control.observer, bench.hover_N, self.n_discs
            ),
            fresh=fresh_flags(rates_Hz, len(schedule), schedule.rate_Hz),
            geometry=geometry,
            gains=np.zeros(len(FilterGains._fields)),
            plan=np.array(plan, np.int64),
        )
        self.use(arrays)
        # At rest, level, rotors at the first collective, sensors read.
        speed_rad_s = np.sqrt(schedule.collective[0] * bench.hover_N / self.view("body.k"))
        self.set_speeds(speed_rad_s)
        self.view("readings.speed_rad_s")[:] = speed_rad_s
        for field in ("setpoint.plate_z_m", "delayed.plate_z_m", "readings.plate_z_m"):
            self.view(field)[:] = schedule.plate_z_m[0]
        arrays.past[2] = schedule.plate_z_m[0]

    def schedule_view(self, field: str) -> Array:
        """Return a view of a field of `Tick` in the schedule (n, n_ticks)."""
        view: Array = self.arrays.schedule[rows_in(tick_slot(self.n_discs), field)]
        return view

    def set_speeds(self, speed_rad_s: Array | float) -> None:
        """Set the speed of every rotor (n_discs, n_lanes), also in the delay."""
        for field in ("rotors.speed", "targets.sent", "targets.old", "targets.new"):
            self.view(f"{field}_rad_s")[:] = speed_rad_s
        self.arrays.sent[:] = self.view("rotors.speed_rad_s")[:, None, :]

    def run(self) -> None:
        """Run all control ticks."""
        self.advance(0, len(self.schedule))

    def set_driver(self, driver: int) -> None:
        """Set the source of commands: `BUILT_IN`, `CALLER` or `PULSES`."""
        self.arrays.plan[LoopPlan._fields.index("driver")] = driver

    def drive(self, pwm_us: Array) -> None:
        """Use logged pulse widths (n_discs, n_ticks) instead of a controller."""
        self.use(self.arrays._replace(schedule=self.arrays.schedule.copy()))
        self.schedule_view("pwm_us")[:] = pwm_us
        self.set_driver(PULSES)

    @cached_property
    def _command(self) -> Any:
        return self.numbers("command")

    def measurements(self, times_s: Sequence[float]) -> Iterator[PitchMeasurement]:
        numbers, speeds = self.numbers("readings"), self.numbers("readings.speed_rad_s")
        read, read_speeds = Struct("3d").unpack_from, Struct(f"{self.n_discs}d").unpack
        for time_s in times_s:
            yield _new(PitchMeasurement, (time_s, *read(numbers), read_speeds(speeds)))

    def references(self, first: int, last: int) -> Iterator[PitchReference]:
        fields = ("setpoint.reference_rad", "setpoint.collective_N", "observer")
        tracks = (self.schedule_view(field)[0, first:last].tolist() for field in fields)
        return map(_new, repeat(PitchReference), zip(*tracks, strict=True))

    def write_command(self, command: PitchCommand | float) -> None:
        torque_Nm, difference_us = command if isinstance(command, tuple) else (command, 0.0)
        if not (isfinite(torque_Nm) and isfinite(difference_us)):
            raise ValueError
        values = self._command
        values[0], values[1] = torque_Nm, difference_us

    def invalid_field(self, command: Any) -> tuple[str, Any, str]:
        if not isinstance(command, tuple):
            return "torque_Nm", command, COMMAND_REMEDY
        if len(command) != len(PitchCommand._fields):
            return "a command", command, COMMAND_REMEDY
        is_torque_valid = isinstance(command[0], int | float) and isfinite(command[0])
        return PitchCommand._fields[is_torque_valid], command[is_torque_valid], COMMAND_REMEDY


@lru_cache(maxsize=64)
def prepare_loop(
    jobs: tuple[PitchJob, ...], lanes: int, neutral_too: bool
) -> tuple[Layout, PitchLoops, Array, dict[PitchJob, Array]]:
    """Return layout, loops, geometry, and the records of each job (n_rows,) (cached)."""
    bench, key = jobs[0].bench, shared_key(jobs[0])
    if any(shared_key(other) != key for other in jobs[1:]):
        raise InputError(
            "lanes of a loop must share rig, rates, delays, and settings of observer and "
            "feedforward; simulate the others separately"
        )
    effects = loop_effects(*(job.bench.model for job in jobs), neutral_too=neutral_too)
    records = {job: lane_records(job, effects) for job in jobs}
    layout = record_layout(**records[jobs[0]])
    geometry = build_geometry(bench.model, 1.0 / bench.plant_rate_Hz)
    x_m, _, arm_m = geometry.body
    sources = list(zip(x_m, arm_m, strict=True))  # the plate tilts only about the hinge
    rules = bench.model.image_rules._replace(body_like=tuple(map(sources.index, sources)))
    law = jobs[0].control.law
    loops = pitch_loops(effects, layout, zero_record(geometry), lanes, rules, law)
    columns = {
        job: np.array(flat_values(tuple(lane.values())), float) for job, lane in records.items()
    }
    return layout, loops, np.array(flat_values(geometry), float), columns


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
    tick = Tick(
        Setpoint(
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


def sensor_delays(bench: PitchBench, rate_Hz: float) -> list[int]:
    """Return the delays of the delayed sensors in control ticks."""
    delays = []
    for name, sensor in zip(SENSOR_NAMES[:3], bench.loop_sensors, strict=False):
        delays.append(round(sensor.delay_s * rate_Hz))
        if delays[-1] >= PAST:
            raise InputError(
                f"{name}.delay_s is {sensor.delay_s:g} s; allowed: up to {(PAST - 1) / rate_Hz:g} s"
            )
    return delays
