"""Filter along a logged pitch experiment with many candidate benches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.parameter import Parameters
from benchtool.core.schedule import PARKED_M, Schedule
from benchtool.core.units import Array
from benchtool.physics.expression import flat_values
from benchtool.physics.model import Model
from benchtool.simulate.controllers.pitch import PitchControl
from benchtool.simulate.hooks import neutral_value
from benchtool.simulate.layout import lend_rows
from benchtool.simulate.loop import LoopPlan
from benchtool.simulate.pitch.bench import STEPS_PER_LAG, PitchBench
from benchtool.simulate.pitch.lane import FREE, RESTART, FilterGains, Setpoint
from benchtool.simulate.pitch.loops import LoggedTick
from benchtool.simulate.pitch.run import PitchJob, PitchLoop

MIN_PARKED_Z_M = 0.95 * PARKED_M  # readings above are a parked plate: 1.0 with noise
TICKS_BEFORE, IS_AT_REST = map(LoopPlan._fields.index, ("ticks_before", "is_at_rest"))
# Compiled numbers of lanes; a loop has the next larger one. 28 are enough for a point and its
# derivatives by all parameters of the catalogue, and take 15 % less time than 32.
LANES = (1, 4, 28)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LoggedPitch:
    """Logged pitch experiment, evenly sampled.

    Attributes:
        pwm_us: (n_discs, n) pulse widths, constant until the next; with `from_speeds`, those for
            which the measured speeds are steady.
        plate_z_m: (n,) distance with the beam level.
        plate_share: (n,) inserted share of the plate, 0 (parked) to 1.
        theta_rad, gyro_rad_s: (n,) readings; nan where there is none.
        speed_rad_s: (n_discs, n) readings; nan where there is none.
        mode: (n,) filter mode, see `lane`.
        start_s: time of the first row, for effects that depend on time.
        from_speeds: use the measured speeds instead of the model from pulse width to speed.
    """

    rate_Hz: float
    pwm_us: Array
    plate_z_m: Array
    plate_share: Array
    theta_rad: Array
    gyro_rad_s: Array
    speed_rad_s: Array
    mode: Array
    start_s: float = 0.0
    from_speeds: bool = False

    def __len__(self) -> int:
        return len(self.plate_z_m)

    @property
    def n_discs(self) -> int:
        """Number of driven discs."""
        return len(self.pwm_us)

    def between(self, first: int, last: int) -> LoggedPitch:
        """Return the rows from `first` up to `last`."""
        columns = {item.name: getattr(self, item.name) for item in fields(self)}
        rows = {name: array[..., first:last] for name, array in columns.items() if np.ndim(array)}
        return replace(self, start_s=self.start_s + first / self.rate_Hz, **rows)


READINGS = ("readings.theta_rad", "readings.gyro_rad_s", "readings.speed_rad_s")
STATE = (
    "hinge.theta_rad", "hinge.rate_rad_s", "hinge.wake_Nm", "hinge.deflection",
    "rotors.speed_rad_s",
)  # fmt: skip


class Predictions(NamedTuple):
    """Predicted readings of benches along a log, one tick ahead.

    Attributes:
        theta_rad, gyro_rad_s: (n, lanes).
        speed_rad_s: (n, n_discs, lanes).
    """

    theta_rad: Array
    gyro_rad_s: Array
    speed_rad_s: Array

    @classmethod
    def of(cls, rows: Array) -> Predictions:
        """Return the predictions in rows (n, 2 + n_discs, lanes) of `READINGS`."""
        return cls(rows[:, 0], rows[:, 1], rows[:, 2:])


def filter_log(benches: Sequence[PitchBench], logged: LoggedPitch, gains: Array) -> Predictions:
    """Return the predictions of each bench along a log, from the readings of its first row.

    Args:
        benches: one per lane, all of one rig. Their sensors are ignored.
        gains: (7,) `FilterGains`.
    """
    return Predictions.of(_filter_windows(benches, logged, gains, READINGS)[0])


def filter_states(benches: Sequence[PitchBench], logged: LoggedPitch, gains: Array) -> Array:
    """Return the corrected states (n, 4 + n_discs, lanes) of each bench along a log.

    They are the first four fields of `Hinge`, and rotor speeds. Arguments as in `filter_log`.
    """
    return _filter_windows(benches, logged, gains, STATE)[0]


def predict_windows(
    benches: Sequence[PitchBench],
    logged: LoggedPitch,
    states: Mapping[int, Array],
    rows: int,
    lead: int,
    seed: int | None = None,
) -> list[Predictions]:
    """Return the predictions of each bench in windows of a log, without corrections.

    Args:
        states: (4 + n_discs, lanes) as of `filter_states`, by the first row of a window.
        lead: pulse widths of so many rows before a window are still in a delay.
    """
    windows = [(max(row - lead, 0), row, row + rows, values) for row, values in states.items()]
    free = replace(logged, mode=np.full(len(logged), float(FREE)))
    gains = np.zeros(len(FilterGains._fields))
    return list(map(Predictions.of, _filter_windows(benches, free, gains, READINGS, windows, seed)))


def _filter_windows(
    benches: Sequence[PitchBench],
    logged: LoggedPitch,
    gains: Array,
    logged_fields: Sequence[str],
    windows: Sequence[tuple[int, int, int, Array | None]] | None = None,
    seed: int | None = None,
) -> list[Array]:
    """Return the rows (n, n_numbers, lanes) of record fields in windows.

    Args:
        windows: first row of the commands, first row, end (exclusive), and initial states; None
            for the whole log, from the readings of its first row.
    """
    if windows is None:
        windows, mode = [(0, 0, len(logged), None)], np.array(logged.mode, float)
        mode[0] = RESTART
        logged = replace(logged, mode=mode)
    rig, zeros = benches[0].model.rig, np.zeros(len(logged))
    if logged.n_discs != rig.n_discs:
        raise InputError(
            f"number of discs differs: log {logged.n_discs}, rig {rig.name!r} {rig.n_discs}; use "
            f"another rig"
        )
    pwm_us, lag_s = logged.pwm_us, 0.0
    if logged.from_speeds:
        # Within a tick speeds follow this lag from one reading to the next: linear interpolation
        # would shift the thrust by a fraction of a millisecond, which under dither looks like a
        # tenth of the friction.
        lag_s = max(rig.propulsion.lag_s, 1.001 * STEPS_PER_LAG / benches[0].plant_rate_Hz)
        remains = np.exp(-1.0 / (logged.rate_Hz * lag_s))
        pwm_us = pwm_us.copy()
        pwm_us[:, :-1] += np.diff(logged.pwm_us, axis=1) / (1.0 - remains)
    setpoint = Setpoint(zeros, zeros, logged.plate_z_m, logged.plate_share)
    ticks = LoggedTick(
        setpoint, (*pwm_us,), logged.mode, logged.theta_rad, logged.gyro_rad_s,
        (*logged.speed_rad_s,),
    )  # fmt: skip
    table, parts = np.array(flat_values(ticks), float), []
    for k in range(0, len(benches), LANES[-1]):
        group = benches[k : k + LANES[-1]]
        loop = _build_loop(group, logged, lag_s, seed, k)
        rows, run, group_parts = loop.layout.row_numbers(logged_fields), loop.loops.filter, []
        log = np.empty((len(logged), len(rows), loop.lanes))
        plan = loop.arrays.plan
        arrays = loop.arrays._replace(log=log, logged=rows, schedule=table, gains=gains)
        addresses = lend_rows(run, arrays)
        plan[TICKS_BEFORE] = round(logged.start_s * logged.rate_Hz)
        for first, start, stop, initial_states in windows:
            if initial_states is not None:
                lane_states = initial_states[:, k : k + LANES[-1]]
                n_missing = loop.lanes - lane_states.shape[1]
                lane_states = np.pad(lane_states, ((0, 0), (0, n_missing)), mode="edge")
                loop.view("hinge")[:4] = lane_states[:4]
                loop.set_speeds(lane_states[4:])
            for is_at_rest, begin, end in ((1, first, start), (0, start, stop)):
                plan[IS_AT_REST] = is_at_rest
                run(addresses, begin, end)
            part = log[start:stop, :, : len(group)]
            group_parts.append(part.copy() if len(windows) > 1 else part)
        parts.append(group_parts)
    if len(parts) == 1:
        return parts[0]
    return [np.concatenate(window, axis=-1) for window in zip(*parts, strict=True)]


def _build_loop(
    benches: Sequence[PitchBench], logged: LoggedPitch, lag_s: float, seed: int | None, first: int
) -> PitchLoop:
    """Return a loop for a log from lane `first`; extra lanes repeat the last bench.

    With a lag the benches lose all other effects of the subsystem pwm_to_rpm: every rotor has its
    measured speeds.
    """
    lanes = next(count for count in LANES if count >= len(benches))
    p = benches[0].model.rig.propulsion
    control = PitchControl(name="logged", gains=None, rate_Hz=logged.rate_Hz)
    job_by_bench = {}
    for bench in benches:
        if id(bench) not in job_by_bench:
            job_bench = replace(bench, sensors={}) if bench.sensors else bench
            if lag_s:
                job_bench = replace(job_bench, model=_with_lag_alone(bench.model, lag_s))
            job_by_bench[id(bench)] = PitchJob(job_bench, control)
    jobs = [job_by_bench[id(bench)] for bench in benches]
    jobs += [jobs[-1]] * (lanes - len(jobs))
    tick = Schedule(name="log", title="", duration_s=1.0 / logged.rate_Hz)
    start = tick.sampled(logged.rate_Hz, p.radius_m)
    loop = PitchLoop(jobs, start, seed or 0, list(range(first, first + lanes)), neutral_too=True)
    if seed is None:
        loop.view("motion.wake_innovation_Nm")[:] = 0.0
    pulse_us = np.maximum(logged.pwm_us[:, 0] - p.pwm_start_us, 0.0)
    loop.set_speeds((p.speed_per_us_rad_s * pulse_us)[:, None])
    return loop


def _with_lag_alone(model: Model, lag_s: float) -> Model:
    """Return the model with only a lag between pulse width and speed."""
    parameters = dict(model.parameters)
    for effect in model.effects:
        values = {}
        if effect.subsystem == "pwm_to_rpm":
            values = {parameter.name: neutral_value(parameter) for parameter in effect.parameters}
        if effect.hooks.lag_s is not None:
            values[effect.parameters[0].name] = lag_s
        for name, value in values.items():
            full_name = f"{effect.name}.{name}"
            parameters[full_name] = parameters[full_name].with_value(value)
    return model.with_values(Parameters(parameters.items()))
