"""Filter along a logged pitch experiment with many candidate benches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import InputError
from benchtool.core.parameter import Parameters
from benchtool.core.schedule import PARKED_M, SampledSchedule
from benchtool.core.units import Array
from benchtool.physics.expression import flat_values
from benchtool.physics.model import Model
from benchtool.simulate.controllers.pitch import PitchControl
from benchtool.simulate.pitch.bench import STEPS_PER_LAG, PitchBench
from benchtool.simulate.pitch.lane import FREE, RESTART, FilterGains, Setpoint
from benchtool.simulate.pitch.loops import LoggedTick
from benchtool.simulate.pitch.run import PitchJob, PitchLoop

MIN_PARKED_Z_M = 0.95 * PARKED_M  # readings above are a parked plate: 1.0 with noise
LANES = (1, 8, 32)  # compiled numbers of lanes; a loop has the next larger one


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
        return replace(self, **rows)

    def schedule(self) -> SampledSchedule:
        """Return the schedule of the plate in the log, without a controller."""
        ticks = len(self)
        zeros = np.zeros(ticks)
        return SampledSchedule(
            rate_Hz=self.rate_Hz,
            time_s=np.arange(ticks) / self.rate_Hz,
            reference_rad=zeros,
            collective=np.ones(ticks),
            dither_us=zeros,
            plate_z_m=np.asarray(self.plate_z_m, float),
            plate_share=np.asarray(self.plate_share, float),
            observer=zeros,
            feedforward=zeros,
        )


class Predictions(NamedTuple):
    """Predictions of benches along a log; fields in the order of `run.FILTERED`.

    Attributes:
        theta_rad, gyro_rad_s: (n, lanes) predicted readings, one tick ahead.
        pitch_rad, rate_rad_s, wake_Nm, deflection: (n, lanes) state after the correction.
        speed_rad_s: (n, n_discs, lanes) predicted readings.
        state_speed_rad_s: (n, n_discs, lanes) rotor speeds after the correction at the tick.
    """

    theta_rad: Array
    gyro_rad_s: Array
    pitch_rad: Array
    rate_rad_s: Array
    wake_Nm: Array
    deflection: Array
    speed_rad_s: Array
    state_speed_rad_s: Array


def filter_log(
    benches: Sequence[PitchBench],
    logged: LoggedPitch,
    gains: Array,
    *,
    start_s: float = 0.0,
    states: Array | None = None,
) -> Predictions:
    """Return the predictions of each bench along a log.

    Args:
        benches: one per lane, all of one rig. Their sensors are ignored.
        gains: (7,) `FilterGains`.
        start_s: time of the first row, for effects that depend on time.
        states: (4 + n_discs, lanes) initial values of the first four fields of `Hinge`, and speeds;
            None means from the readings of the first row.
    """
    mode = np.array(logged.mode, float)
    if states is None:
        mode[0] = RESTART
    whole, before = [(0, 0, len(logged))], round(start_s * logged.rate_Hz)
    logged = replace(logged, mode=mode)
    return _filter_windows(benches, logged, gains, whole, [states], None, before)[0]


def predict_windows(
    benches: Sequence[PitchBench],
    logged: LoggedPitch,
    starts: Sequence[int] | NDArray[np.intp],
    rows: int,
    lead: int,
    states: Sequence[Array],
    seed: int | None = None,
) -> list[Predictions]:
    """Return the predictions of each bench in windows of a log, without corrections.

    Pulse widths of `lead` rows before a window are still in a delay.
    """
    windows = [(max(int(start) - lead, 0), int(start), int(start) + rows) for start in starts]
    free = replace(logged, mode=np.full(len(logged), float(FREE)))
    return _filter_windows(benches, free, np.zeros(len(FilterGains._fields)), windows, states, seed)


def _filter_windows(
    benches: Sequence[PitchBench],
    logged: LoggedPitch,
    gains: Array,
    windows: Sequence[tuple[int, int, int]],
    states: Sequence[Array | None],
    seed: int | None,
    before: int = 0,
) -> list[Predictions]:
    """Return the predictions in windows: first row of the commands, first row, end (exclusive)."""
    parts = []
    for k in range(0, len(benches), LANES[-1]):
        group = benches[k : k + LANES[-1]]
        loop = _build_loop(group, logged, None if seed is None else seed + k)
        setpoint = Setpoint(*loop.schedule_view("setpoint"))
        ticks = LoggedTick(
            setpoint, (*loop.schedule_view("pwm_us"),), logged.mode, logged.theta_rad,
            logged.gyro_rad_s, (*logged.speed_rad_s,),
        )  # fmt: skip
        table, predictions = np.array(flat_values(ticks), float), []
        for (first, start, stop), initial_states in zip(windows, states, strict=True):
            if initial_states is not None:
                lane_states = initial_states[:, k : k + LANES[-1]]
                n_missing = loop.lanes - lane_states.shape[1]
                lane_states = np.pad(lane_states, ((0, 0), (0, n_missing)), mode="edge")
                loop.view("hinge")[:4] = lane_states[:4]
                loop.set_speeds(lane_states[4:])
            log = loop.filter(table, gains, before, (first, start, stop))[:, :, : len(group)]
            scalars = [log[:, column] for column in range(6)]
            predictions.append(Predictions(*scalars, *np.split(log[:, 6:], 2, axis=1)))
        parts.append(predictions)
    if len(parts) == 1:
        return parts[0]
    return [
        Predictions(*(np.concatenate(fields, axis=-1) for fields in zip(*window, strict=True)))
        for window in zip(*parts, strict=True)
    ]


def _build_loop(benches: Sequence[PitchBench], logged: LoggedPitch, seed: int | None) -> PitchLoop:
    """Return a loop driven by the logged pulse widths; extra lanes repeat the last bench."""
    lanes = next(count for count in LANES if count >= len(benches))
    discs, rig = logged.n_discs, benches[0].model.rig
    if discs != rig.n_discs:
        raise InputError(
            f"number of discs differs: log {discs}, rig {rig.name!r} {rig.n_discs}; use another rig"
        )
    p, first_us = rig.propulsion, logged.pwm_us[:, 0]
    if logged.from_speeds:
        benches, logged = _without_motors(benches, logged)
    control = PitchControl(name="logged", gains=None, rate_Hz=logged.rate_Hz)
    job_by_bench = {id(bench): PitchJob(replace(bench, sensors={}), control) for bench in benches}
    jobs = [job_by_bench[id(bench)] for bench in benches]
    jobs += [jobs[-1]] * (lanes - len(jobs))
    loop = PitchLoop(
        jobs, logged.schedule(), seed or 0, list(range(lanes)), external=True, neutral_too=True
    )
    loop.drive(np.ascontiguousarray(logged.pwm_us, float))
    if seed is None:
        loop.view("motion.wake_innovation_Nm")[:] = 0.0
    steady_rad_s = p.speed_per_us_rad_s * np.maximum(first_us - p.pwm_start_us, 0.0)
    loop.set_speeds(steady_rad_s[:, None])
    return loop


def _without_motors(
    benches: Sequence[PitchBench], logged: LoggedPitch
) -> tuple[Sequence[PitchBench], LoggedPitch]:
    """Return benches and pulse widths for which every rotor has its measured speeds.

    The benches lose all effects of the subsystem pwm_to_rpm. Within a tick speeds follow the lag of
    the rig from one reading to the next: linear interpolation would shift the thrust by a fraction
    of a millisecond, which under dither looks like a tenth of the friction.
    """
    first_bench = benches[0]
    p = first_bench.model.rig.propulsion
    lag_s = max(p.lag_s, 1.001 * STEPS_PER_LAG / first_bench.plant_rate_Hz)
    remains = np.exp(-1.0 / (logged.rate_Hz * lag_s))
    drive = logged.pwm_us.copy()
    drive[:, :-1] += np.diff(logged.pwm_us, axis=1) / (1.0 - remains)
    models = {id(bench): _with_lag_alone(bench.model, lag_s) for bench in benches}
    bench_by_id = {id(bench): replace(bench, model=models[id(bench)]) for bench in benches}
    return [bench_by_id[id(bench)] for bench in benches], replace(logged, pwm_us=drive)


def _with_lag_alone(model: Model, lag_s: float) -> Model:
    """Return the model with only a lag between pulse width and speed."""
    values = {
        f"{effect.name}.{effect.parameters[0].name}": lag_s
        for effect in model.effects
        if effect.hooks.lag_s is not None
    }
    for effect in model.effects:
        if effect.subsystem == "pwm_to_rpm":
            for parameter in effect.parameters:
                neutral = parameter.value if parameter.neutral is None else parameter.neutral
                values.setdefault(f"{effect.name}.{parameter.name}", neutral)
    parameters = model.parameters
    return model.with_values(
        Parameters(
            (name, parameter.with_value(values.get(name, parameter.value)))
            for name, parameter in parameters.items()
        )
    )
