"""Filter one logged pitch experiment with many candidate benches at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.core.errors import InputError
from benchtool.core.parameter import Parameters
from benchtool.core.schedule import PARKED_M, SampledSchedule
from benchtool.physics.expression import flat_values
from benchtool.physics.model import Model
from benchtool.simulate.controllers.pitch import PitchControl
from benchtool.simulate.pitch.bench import STEPS_PER_LAG, PitchBench
from benchtool.simulate.pitch.filter_ticks import FREE, RESTART, FilterGains, LoggedTick
from benchtool.simulate.pitch.records import Setpoint
from benchtool.simulate.pitch.run import PitchJob, PitchLoop

PARKED_FROM_M = 0.95 * PARKED_M  # greater readings are parked: a noisy 1.0 is no plate
LANES = (1, 8, 32)  # numbers of lanes that loops are compiled for; a loop takes the next larger one


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LoggedPitch:
    """Hold a logged pitch experiment, evenly spaced.

    Attributes:
        pwm_us: (n_discs, n) pulses, each held until the next; with `from_speeds`, the pulses at
            which rotors would settle at the speed that was measured.
        plate_z_m: (n,) distance with the beam level.
        plate_share: (n,) how far the plate is in, 0 (parked) to 1.
        theta_rad, gyro_rad_s: (n,) readings; nan where there was none.
        speed_rad_s: (n_discs, n) readings; nan where there was none.
        mode: (n,) what a filter does with the readings, see `filter_ticks`.
        from_speeds: whether rotors turn as they were measured, whatever a model says of the way
            from pulse to speed.
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
        """How many discs were driven."""
        return len(self.pwm_us)

    def __post_init__(self) -> None:
        n, discs = len(self), len(self.pwm_us)
        for name, shape in (
            ("pwm_us", (discs, n)), ("speed_rad_s", (discs, n)), ("theta_rad", (n,)),
            ("gyro_rad_s", (n,)), ("mode", (n,)),
            ("plate_share", (n,)),
        ):  # fmt: skip
            if getattr(self, name).shape != shape:
                raise InputError(
                    f"{name} has the shape {getattr(self, name).shape}, but {discs} discs and {n} "
                    f"plate distances need {shape}"
                )

    def between(self, first: int, last: int) -> LoggedPitch:
        """Return the rows from `first` up to `last`."""
        columns = {item.name: getattr(self, item.name) for item in fields(self)}
        rows = {name: x[..., first:last] for name, x in columns.items() if np.ndim(x)}
        return replace(self, **rows)

    def schedule(self) -> SampledSchedule:
        """Return the plate's part of the log as a schedule without a controller."""
        ticks = len(self)
        still = np.zeros(ticks)
        return SampledSchedule(
            rate_Hz=self.rate_Hz,
            time_s=np.arange(ticks) / self.rate_Hz,
            reference_rad=still,
            collective=np.ones(ticks),
            dither_us=still,
            plate_z_m=np.asarray(self.plate_z_m, float),
            plate_share=np.asarray(self.plate_share, float),
            observer=still,
            feedforward=still,
        )


class Predictions(NamedTuple):
    """Hold what benches made of a log, lanes last; fields in the order of `run.FILTERED`.

    Attributes:
        theta_rad, gyro_rad_s: (n, lanes) predicted readings, each from the tick before.
        pitch_rad, rate_rad_s, wake_Nm, bent: (n, lanes) the state after the readings of the tick.
        speed_rad_s: (n, n_discs, lanes) predicted readings.
        state_speed_rad_s: (n, n_discs, lanes) rotor speeds after the readings of the tick.
    """

    theta_rad: Array
    gyro_rad_s: Array
    pitch_rad: Array
    rate_rad_s: Array
    wake_Nm: Array
    bent: Array
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
    """Return what each bench predicts along a log.

    Args:
        benches: one per lane; all of one rig. Their sensors do not matter.
        gains: (7,) of the filter, `FilterGains`.
        start_s: time of the first row, for what changes with time.
        states: (4 + n_discs, lanes) a `Hinge`'s first four numbers and speeds to begin with;
            from the first row's readings when None.
    """
    mode = np.array(logged.mode, float)
    if states is None:
        mode[0] = RESTART
    whole, before = [(0, 0, len(logged))], round(start_s * logged.rate_Hz)
    return _filtered(benches, replace(logged, mode=mode), gains, whole, [states], None, before)[0]


def predict_windows(
    benches: Sequence[PitchBench],
    logged: LoggedPitch,
    starts: Sequence[int] | NDArray[np.intp],
    rows: int,
    lead: int,
    states: Sequence[Array],
    seed: int | None = None,
) -> list[Predictions]:
    """Return what each bench predicts in each of many windows of a log, without its readings.

    Args:
        lead: rows before a window whose pulses a delay may still hold.
    """
    windows = [(max(int(start) - lead, 0), int(start), int(start) + rows) for start in starts]
    free = replace(logged, mode=np.full(len(logged), float(FREE)))
    return _filtered(benches, free, np.zeros(len(FilterGains._fields)), windows, states, seed)


def _filtered(
    benches: Sequence[PitchBench],
    logged: LoggedPitch,
    gains: Array,
    windows: Sequence[tuple[int, int, int]],
    states: Sequence[Array | None],
    seed: int | None,
    before: int = 0,
) -> list[Predictions]:
    """Return what benches make of windows of a log.

    Args:
        windows: of each the row from which its pulses are sent, its first row, and the row to stop
            before.
    """
    parts = []
    for k in range(0, len(benches), LANES[-1]):
        some = benches[k : k + LANES[-1]]
        loop = _loop(some, logged, None if seed is None else seed + k)
        setpoint = Setpoint(*loop.planned("setpoint"))
        ticks = LoggedTick(
            setpoint, (*loop.planned("pwm_us"),), logged.mode, logged.theta_rad,
            logged.gyro_rad_s, (*logged.speed_rad_s,),
        )  # fmt: skip
        table, found = np.array(flat_values(ticks), float), []
        for (first, start, stop), begun in zip(windows, states, strict=True):
            if begun is not None:
                wide = begun[:, k : k + LANES[-1]]
                wide = np.pad(wide, ((0, 0), (0, loop.lanes - wide.shape[1])), mode="edge")
                loop.view("hinge")[:4] = wide[:4]
                loop.set_speeds(wide[4:])
            log = loop.filter(table, gains, before, (first, start, stop))[:, :, : len(some)]
            scalars = [log[:, k] for k in range(6)]
            found.append(Predictions(*scalars, *np.split(log[:, 6:], 2, axis=1)))
        parts.append(found)
    if len(parts) == 1:
        return parts[0]
    return [
        Predictions(*(np.concatenate(fields, axis=-1) for fields in zip(*window, strict=True)))
        for window in zip(*parts, strict=True)
    ]


def _loop(benches: Sequence[PitchBench], logged: LoggedPitch, seed: int | None) -> PitchLoop:
    """Return a loop that the log's pulses drive; lanes left over repeat the last bench."""
    lanes = next(count for count in LANES if count >= len(benches))
    discs, rig = logged.n_discs, benches[0].model.rig
    if discs != rig.n_discs:
        raise InputError(
            f"the log drives {discs} discs, but rig {rig.name!r} has {rig.n_discs}; name another "
            f"rig"
        )
    p, first_us = rig.propulsion, logged.pwm_us[:, 0]
    if logged.from_speeds:
        benches, logged = _without_motors(benches, logged)
    control = PitchControl(name="logged", gains=None, rate_Hz=logged.rate_Hz)
    once = {id(bench): PitchJob(replace(bench, sensors={}), control) for bench in benches}
    jobs = [once[id(bench)] for bench in benches]
    jobs += [jobs[-1]] * (lanes - len(jobs))
    loop = PitchLoop(
        jobs, logged.schedule(), seed or 0, list(range(lanes)), external=True, neutral_too=True
    )
    loop.drive(np.ascontiguousarray(logged.pwm_us, float))
    if seed is None:
        loop.view("motion.wake_kick_Nm")[:] = 0.0
    settled = p.speed_per_us_rad_s * np.maximum(first_us - p.pwm_start_us, 0.0)
    loop.set_speeds(settled[:, None])
    return loop


def _without_motors(
    benches: Sequence[PitchBench], logged: LoggedPitch
) -> tuple[Sequence[PitchBench], LoggedPitch]:
    """Return benches and pulses that take every rotor through its measured speeds.

    Nothing of the subsystem pwm_to_rpm is left in the benches. Within a tick speeds go from one
    reading to the next along the rig's own lag: a straighter way shifts the thrust by a fraction
    of a millisecond, which dither turns into a tenth of a friction.
    """
    first = benches[0]
    p = first.model.rig.propulsion
    lag_s = max(p.lag_s, 1.001 * STEPS_PER_LAG / first.plant_rate_Hz)
    remains = np.exp(-1.0 / (logged.rate_Hz * lag_s))
    drive = logged.pwm_us.copy()
    drive[:, :-1] += np.diff(logged.pwm_us, axis=1) / (1.0 - remains)
    models = {id(bench): _with_lag_alone(bench.model, lag_s) for bench in benches}
    bare = {id(bench): replace(bench, model=models[id(bench)]) for bench in benches}
    return [bare[id(bench)] for bench in benches], replace(logged, pwm_us=drive)


def _with_lag_alone(model: Model, lag_s: float) -> Model:
    """Return the model without anything between pulse and speed but a lag."""
    values = {
        f"{effect.name}.{effect.parameters[0].name}": lag_s
        for effect in model.effects
        if effect.hooks.lag_s is not None
    }
    for effect in model.effects:
        if effect.subsystem == "pwm_to_rpm":
            for item in effect.parameters:
                neutral = item.value if item.neutral is None else item.neutral
                values.setdefault(f"{effect.name}.{item.name}", neutral)
    items = model.parameters
    return model.with_values(
        Parameters(
            (name, item.with_value(values.get(name, item.value))) for name, item in items.items()
        )
    )
