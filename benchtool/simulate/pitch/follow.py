"""Follow one logged pitch experiment with many candidate benches at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array import Array
from benchtool.core.errors import InputError
from benchtool.core.parameter import Parameters
from benchtool.core.schedule import SampledSchedule
from benchtool.physics.model import Model
from benchtool.simulate.controllers.pitch import PitchControl
from benchtool.simulate.pitch import track as t
from benchtool.simulate.pitch.bench import STEPS_PER_LAG, PitchBench
from benchtool.simulate.pitch.run import PitchJob, PitchLoop

_MODE = t.Seen._fields.index("mode")

LANES = (1, 8, 32)
"""Numbers of lanes that loops are compiled for; a loop takes the next larger one."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LoggedPitch:
    """Hold a logged pitch experiment, evenly spaced.

    Attributes:
        rate_Hz: of the log.
        pwm_us: (n_discs, n) pulses, each held until the next; where `turned`, the pulses at which
            rotors would settle at the speed that was measured.
        plate_z_m: (n,) distance with the beam level.
        plate_share: (n,) how far the plate is in, 0 (parked) to 1.
        theta_rad, gyro_rad_s: (n,) readings; nan where there was none.
        speed_rad_s: (n_discs, n) readings; nan where there was none.
        mode: (n,) what a filter does with the readings, see `pitch_track`.
        turned: whether rotors turn as they were measured, whatever a model says of the way from
            pulse to speed.
    """

    rate_Hz: float
    pwm_us: Array
    plate_z_m: Array
    plate_share: Array
    theta_rad: Array
    gyro_rad_s: Array
    speed_rad_s: Array
    mode: Array
    turned: bool = False

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
        rows = slice(first, last)
        return replace(
            self,
            pwm_us=self.pwm_us[:, rows],
            plate_z_m=self.plate_z_m[rows],
            plate_share=self.plate_share[rows],
            theta_rad=self.theta_rad[rows],
            gyro_rad_s=self.gyro_rad_s[rows],
            speed_rad_s=self.speed_rad_s[:, rows],
            mode=self.mode[rows],
        )

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


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """Hold what benches made of a log, lanes last.

    Attributes:
        theta_rad, gyro_rad_s: (n, lanes) predicted readings, each from the tick before.
        speed_rad_s: (n, n_discs, lanes) the same.
        pitch_rad, rate_rad_s, wake_Nm: (n, lanes) the state after the readings of the tick.
        turning_rad_s: (n, n_discs, lanes) rotor speeds after the readings of the tick.
    """

    theta_rad: Array
    gyro_rad_s: Array
    speed_rad_s: Array
    pitch_rad: Array
    rate_rad_s: Array
    wake_Nm: Array
    turning_rad_s: Array


def follow(
    benches: Sequence[PitchBench],
    logged: LoggedPitch,
    gains: Array,
    *,
    start_s: float = 0.0,
    states: Array | None = None,
    seed: int | None = None,
) -> Followed:
    """Return what each bench predicts along a log.

    Args:
        benches: one per lane; all of one rig. Their sensors do not matter.
        logged: the experiment.
        gains: (7,) of the filter, see `pitch_track`.
        start_s: time of the first row, for what changes with time.
        states: (3 + n_discs, lanes) pitch, rate, wake torque and speeds to begin with; from the
            first row's readings when None.
        seed: of the wake's torque; the wake's torque only decays when None.
    """
    lanes = _lanes(len(benches))
    if len(benches) > lanes:
        parts = [
            follow(
                benches[k : k + lanes], logged, gains, start_s=start_s,
                states=None if states is None else states[:, k : k + lanes],
                seed=None if seed is None else seed + k,
            )
            for k in range(0, len(benches), lanes)
        ]  # fmt: skip
        return _joined(parts)
    loop = _loop(benches, logged, lanes, seed)
    mode = np.array(logged.mode, float)
    if states is None:
        mode[0] = t.RESTART
    else:
        _begin(loop, states)
    log = loop.follow(_seen(logged, mode), gains, round(start_s * logged.rate_Hz))
    return _followed(log, len(benches), logged.n_discs)


def follow_windows(
    benches: Sequence[PitchBench],
    logged: LoggedPitch,
    starts: Sequence[int] | NDArray[np.intp],
    rows: int,
    lead: int,
    states: Sequence[Array],
    seed: int | None = None,
) -> list[Followed]:
    """Return what each bench predicts in each of many windows of a log, without its readings.

    Args:
        benches: one per lane, as for `follow`.
        logged: the experiment.
        starts: first row of each window.
        rows: of a window.
        lead: rows before a window whose pulses a delay may still hold.
        states: (3 + n_discs, lanes) for each window, pitch, rate, wake torque and speeds to begin
            with.
        seed: of the wake's torque; the wake's torque only decays when None.
    """
    lanes = _lanes(len(benches))
    if len(benches) > lanes:
        parts = [
            follow_windows(
                benches[k : k + lanes], logged, starts, rows, lead,
                [state[:, k : k + lanes] for state in states],
                None if seed is None else seed + k,
            )
            for k in range(0, len(benches), lanes)
        ]  # fmt: skip
        return [_joined(window) for window in zip(*parts, strict=True)]
    loop = _loop(benches, logged, lanes, seed)
    seen = _seen(logged, np.full(len(logged), float(t.FREE)))
    nothing = np.zeros(len(t.FilterGains._fields))
    found = []
    for start, state in zip(starts, states, strict=True):
        first = max(int(start) - lead, 0)
        _begin(loop, state)
        seen[_MODE, first:start] = t.WAIT
        log = loop.follow(seen, nothing, span=(first, int(start) + rows))
        seen[_MODE, first:start] = t.FREE
        found.append(_followed(log[start - first :], len(benches), logged.n_discs))
    return found


def _lanes(benches: int) -> int:
    """Return how many lanes a loop for so many benches has, at most."""
    return next((count for count in LANES if count >= benches), LANES[-1])


def _loop(
    benches: Sequence[PitchBench], logged: LoggedPitch, lanes: int, seed: int | None
) -> PitchLoop:
    """Return a loop that the log's pulses drive; lanes to spare repeat the last bench."""
    first_us = logged.pwm_us[:, 0]
    if logged.turned:
        benches, logged = _turning(benches, logged)
    control = PitchControl(name="logged", gains=None, rate_Hz=logged.rate_Hz)
    once = {id(bench): PitchJob(replace(bench, sensors={}), control) for bench in benches}
    jobs = [once[id(bench)] for bench in benches]
    jobs += [jobs[-1]] * (lanes - len(jobs))
    discs = logged.n_discs
    first = benches[0]
    if discs != first.model.rig.n_discs:
        raise InputError(
            f"the log drives {discs} discs, but rig {first.model.rig.name!r} has "
            f"{first.model.rig.n_discs}; name another rig"
        )
    loop = PitchLoop(
        jobs, logged.schedule(), seed or 0, list(range(lanes)), external=True, neutral_too=True
    )
    loop.drive(np.ascontiguousarray(logged.pwm_us, float))
    if seed is None:
        loop.view("motion.wake_kick_Nm")[:] = 0.0
    p = first.model.rig.propulsion
    settled = p.speed_per_us_rad_s * np.maximum(first_us - p.pwm_start_us, 0.0)
    _turn(loop, settled[:, None])
    return loop


def _begin(loop: PitchLoop, states: Array) -> None:
    """Put every lane into a state (3 + n_discs, lanes)."""
    wide = np.pad(states, ((0, 0), (0, loop.lanes - states.shape[1])), mode="edge")
    loop.view("hinge")[:3] = wide[:3]
    _turn(loop, wide[3:])


def _turn(loop: PitchLoop, speed_rad_s: Array) -> None:
    """Let rotors turn at these speeds (n_discs, lanes), with no other on its way."""
    loop.view("rotors.speed_rad_s")[:] = speed_rad_s
    loop.sent[:] = loop.view("rotors.speed_rad_s")[:, None, :]


def _seen(logged: LoggedPitch, mode: Array) -> Array:
    """Return what the filter sees (3 + n_discs, n)."""
    return np.ascontiguousarray(
        np.vstack([mode, logged.theta_rad, logged.gyro_rad_s, logged.speed_rad_s])
    )


def _followed(log: Array, benches: int, discs: int) -> Followed:
    """Return the logged rows (n, n_rows, lanes) of the lanes in use, by name."""
    used = log[:, :, :benches]
    return Followed(
        theta_rad=used[:, 0],
        gyro_rad_s=used[:, 1],
        speed_rad_s=used[:, 5 : 5 + discs],
        pitch_rad=used[:, 2],
        rate_rad_s=used[:, 3],
        wake_Nm=used[:, 4],
        turning_rad_s=used[:, 5 + discs :],
    )


def _turning(
    benches: Sequence[PitchBench], logged: LoggedPitch
) -> tuple[Sequence[PitchBench], LoggedPitch]:
    """Return benches and pulses that take every rotor through its measured speeds.

    Nothing of the stage pwm_to_rpm is left in the benches. Within a tick speeds go from one
    reading to the next along the rig's own lag: a straighter way shifts the thrust by a fraction
    of a millisecond, which dither turns into a tenth of a friction.
    """
    first = benches[0]
    p = first.model.rig.propulsion
    lag_s = max(p.lag_s, 1.001 * STEPS_PER_LAG / first.plant_rate_Hz)
    kept = np.exp(-1.0 / (logged.rate_Hz * lag_s))
    drive = logged.pwm_us.copy()
    drive[:, :-1] += np.diff(logged.pwm_us, axis=1) / (1.0 - kept)
    once = {id(bench): replace(bench, model=_as_turned(bench.model, lag_s)) for bench in benches}
    return [once[id(bench)] for bench in benches], replace(logged, pwm_us=drive, turned=False)


def _as_turned(model: Model, lag_s: float) -> Model:
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
    return model.at(
        Parameters((name, item.at(values.get(name, item.value))) for name, item in items.items())
    )


def _joined(parts: Sequence[Followed]) -> Followed:
    return Followed(
        *(
            np.concatenate([getattr(part, name) for part in parts], axis=-1)
            for name in Followed.__slots__
        )
    )
