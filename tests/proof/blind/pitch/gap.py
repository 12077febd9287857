"""How far a model misses a part of a record: its physics alone, driven by the recorded pulses.

Every window starts where the bench truly was and runs without wake torque. The true model's miss is
the floor: what wake and sensors make of it. A model without what is hidden misses by more, or the
hidden thing does not matter. This is the generator's own measure; nothing is fitted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tests.proof.blind.pitch.beam import STEP_S
from tests.proof.blind.pitch.library import NAMED
from tests.proof.blind.pitch.loop import Instruments, Part
from tests.proof.blind.pitch.moving import STEPS, Moving, State
from tests.proof.blind.pitch.outside import without_outside
from tests.proof.blind.pitch.plant import Plant
from tests.proof.blind.pitch.records import Truth
from tests.proof.blind.pitch.sheet import SHEET

Array = NDArray[np.float64]

WINDOW_S = 1.0
CHANNELS = ("theta", "gyro", "rpm1", "rpm2")


@dataclass(frozen=True, slots=True, kw_only=True)
class Gap:
    """Hold the root mean square miss of each channel, in the channel's unit, and the floor's."""

    without: dict[str, float]
    floor: dict[str, float]

    @property
    def ratio(self) -> dict[str, float]:
        """Return each channel's miss in floors."""
        return {name: self.without[name] / self.floor[name] for name in CHANNELS}


def shown(
    part: Part,
    truth: Plant,
    model: Plant,
    window_s: float = WINDOW_S,
    *,
    first: int = 0,
    wake: bool = False,
) -> Array:
    """Return what the instruments of a model would show (4, n), one window after the other.

    The rows are those of CHANNELS. Each window starts from the true state; arms that the model
    does not let flex start at what hub and arms have on average. Rows before `first`, where the
    first window starts, are nan. With `wake` the wake's torque at a window's start is known too,
    and dies away as it does on average.
    """
    span = round(window_s / SHEET.dt)
    n = len(part.states)
    pulses = list(zip(part.table["pwm1"].tolist(), part.table["pwm2"].tolist(), strict=True))
    plates = part.plate_m.tolist()
    true_instruments = Instruments(truth)
    shafts = []
    for state in part.states:
        true_instruments.angle(state.positions[0])
        shafts.append(true_instruments.shaft_rad)
    bench = Moving(model)
    out = np.full((len(CHANNELS), n), np.nan)
    kept = np.exp(-STEP_S / truth.wake_tau_s * np.arange(span * STEPS)).reshape(span, STEPS)
    still = np.zeros(STEPS)
    for start in range(first, n, span):
        dying = kept * part.wake_Nm[start]
        before = pulses[max(start - 20, 0) : start] or [(SHEET.base_pwm, SHEET.base_pwm)]
        state = part.states[start]
        if truth.flexible and not model.flexible:
            state = _averaged(state, truth)
        bench.restore(state, before, start * SHEET.dt, SHEET.dt)
        instruments = Instruments(model, shafts[start])
        for k in range(start, min(start + span, n)):
            rpm1, rpm2 = bench.speed_rpm
            angle, rate = instruments.angle(bench.theta_rad), instruments.rate(bench.rate_rad_s)
            out[:, k] = angle, rate, rpm1, rpm2
            blown = dying[k - start] if wake else still
            bench.advance(pulses[k], plates[k], blown, k * SHEET.dt)
    return out


def _averaged(state: State, truth: Plant) -> State:
    share = 1.0 - truth.flex_hub_share
    return replace(
        state,
        positions=(state.positions[0] + share * state.positions[1],),
        rates=(state.rates[0] + share * state.rates[1],),
    )


def miss(part: Part, truth: Plant, model: Plant, window_s: float = WINDOW_S) -> dict[str, float]:
    """Return a model's root mean square miss of each channel."""
    errors = shown(part, truth, model, window_s) - part.table[list(CHANNELS)].to_numpy().T
    return dict(zip(CHANNELS, np.sqrt(np.mean(errors**2, axis=1)).tolist(), strict=True))


def floor_of(part: Part, truth: Plant, window_s: float) -> dict[str, float]:
    """Return the true model's miss where each window's start is known as well as it can be.

    Wake and all; windows begin in the middle of the ones before, too.
    """
    seen = part.table[list(CHANNELS)].to_numpy().T
    half = round(0.5 * window_s / SHEET.dt)
    errors = np.hstack(
        [shown(part, truth, truth, window_s, first=k, wake=True) - seen for k in (0, half)]
    )
    roots = np.sqrt(np.nanmean(errors**2, axis=1))
    return dict(zip(CHANNELS, roots.tolist(), strict=True))


def without_hidden(truth: Truth) -> Plant:
    """Return the true model with only what is hidden taken out."""
    plant = without_outside(truth.plant)
    for effect in truth.effects:
        named = NAMED[effect.name]
        plant = named.put_into(plant, named.neutral)
    return plant


def gap(part: Part, truth: Truth, window_s: float = WINDOW_S) -> Gap:
    """Return what leaving out the hidden thing costs on one part, beside the floor."""
    return Gap(
        without=miss(part, truth.plant, without_hidden(truth), window_s),
        floor=miss(part, truth.plant, truth.plant, window_s),
    )
