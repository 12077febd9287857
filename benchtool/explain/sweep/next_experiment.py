"""Choose the next plate sweep: the one in which rival explanations differ most.

The points of each option are worked out with one rival taken for true, and the other is fitted to
them with everything within its tolerance free. What remains in the sum of squares is what the sweep
is expected to show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import tomli_w

from benchtool.core.array import Array
from benchtool.core.rig import Rig
from benchtool.explain.engine.hypotheses import ratio_of
from benchtool.explain.engine.verdict import NextExperiment
from benchtool.explain.sweep.evidence import SweepEvidence
from benchtool.explain.sweep.log import SweepLog
from benchtool.fit.uncertainty.bench_errors import stays_of
from benchtool.physics.conditions import FAR_AWAY_M, Conditions, load_directions
from benchtool.physics.effects.effect import Subsystem
from benchtool.physics.rotor import speed_from_pwm

VISIT_S, MOVE_S, TARE_S = 5.0, 3.0, 6.0
"""Usual spans of a sweep: a level settled and sampled, the plate moved, a tare; guesses."""

LEAST_SPAN = 0.25
"""Levels are spread over at least this share of the greatest pulse past the start; a choice."""

ROOM = 0.9
"""Share of the limit on thrust that a proposed sweep goes to; a choice."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepOption:
    """Describe a sweep in the terms of a plan.

    Every second repeat goes backwards, so that levels and distances are approached from both sides.

    Attributes:
        inside_over_R: how far the plate's edge lies within the middle discs' axes, on both sides.
        distances_m, lateral_m, pwm_us: the same in a rig's own numbers, once it is `proposed`.
    """

    name: str  # of the plan
    title: str  # what to do
    reason: str  # why it distinguishes explanations
    z_over_R: tuple[float, ...]  # distances
    aside_over_R: tuple[float, ...] = (0.0,)  # lateral positions of the plate, discs still over it
    inside_over_R: tuple[float, ...] = ()
    levels: int = 2  # how many pulse levels
    repeats: int = 2  # visits of each setting
    tare_minutes: float = 0.0  # between tares; 0 for one at the start
    distances_m: tuple[float, ...] = ()
    lateral_m: tuple[float, ...] = ()
    pwm_us: tuple[float, ...] = ()

    def toml(self) -> str:
        """Return the plan that `benchtool sweep --plan` reads."""
        return tomli_w.dumps(
            {
                "name": self.name,
                "repeats": self.repeats,
                "plate": {"distances_m": self.distances_m, "lateral_m": self.lateral_m},
                "throttle": {"pwm_us": self.pwm_us},
                "order": {"kind": "counterbalanced", "references": True, "anchor_every": 0},
                "tare": {"every_minutes": self.tare_minutes},
            }
        )


def proposed(option: SweepOption, evidence: SweepEvidence) -> SweepOption:
    """Return an option in the numbers of the rig, within its limits."""
    rig = evidence.model.rig
    radius_m = rig.propulsion.radius_m
    distances = [
        round(ratio * radius_m, 4)
        for ratio in option.z_over_R
        if rig.plate.z_min_m <= ratio * radius_m < rig.plate.z_park_m
    ]
    aside = [ratio * radius_m for ratio in option.aside_over_R]
    edges = [0.5 * rig.plate.size_x_m - inside * radius_m for inside in option.inside_over_R]
    lateral = [*aside, *edges, *(-edge for edge in edges)]
    # Pulse levels over the range that was swept, widened where it was narrow.
    p = rig.propulsion
    seen = [log.power.pulse_us for log in evidence.logs if log.power is not None]
    if seen:
        pulses = np.concatenate(seen)
        low, high = float(pulses.min()), float(pulses.max())
    else:
        span = min(p.pwm_max_us, rig.limits.pwm_us) - p.pwm_start_us
        low, high = p.pwm_start_us + 0.4 * span, p.pwm_start_us + 0.6 * span
    low = min(low, high - LEAST_SPAN * (high - p.pwm_start_us))
    sweep = replace(
        option,
        distances_m=tuple(distances) or (round(2.0 * rig.plate.z_min_m, 4),),
        lateral_m=tuple(
            dict.fromkeys(round(x_m, 4) for x_m in lateral if abs(x_m) <= rig.plate_x_max_m)
        ),
        pwm_us=tuple(float(round(level)) for level in np.linspace(low, high, option.levels)),
    )
    limit_N = ROOM * min(rig.limits.thrust_N, rig.limits.load_cell_rating_N)
    here = np.zeros((1, len(evidence.parameters)))
    while True:
        most_N = float(evidence.thrusts(points_of(sweep, evidence).conditions, here).max())
        if most_N <= limit_N:
            return sweep
        less = tuple(
            round(p.pwm_start_us + 0.95 * (pulse - p.pwm_start_us)) for pulse in sweep.pwm_us
        )
        sweep = replace(sweep, pwm_us=tuple(dict.fromkeys(float(pulse) for pulse in less)))


def points_of(sweep: SweepOption, evidence: SweepEvidence) -> SweepLog:
    """Return the points that a sweep would visit, thrust and speeds still those of the model."""
    rig = evidence.model.rig
    rows = _visits(sweep, rig)
    tare = rows[:, 0] == 0.0
    pulse, z_m, x_m, time, elapsed = rows.T
    speed = speed_at(pulse, rig)
    place = np.array([z_m, x_m, np.zeros(len(rows))])
    like = evidence.logs[0]
    conditions = Conditions.of(
        rig,
        speed_rad_s=np.broadcast_to(speed, (rig.n_rotors, len(rows))),
        plate_z_m=z_m,
        plate_x_m=x_m,
        elapsed_s=elapsed,
        time_s=time,
        load_direction=load_directions(time, elapsed, place, speed**2),
        speed_measured=like.conditions.speed_measured,
    )
    power = None
    if like.power is not None:
        power = like.power.planned(time[~tare], pulse[~tare], speed[~tare])
    return replace(
        like,
        conditions=conditions,
        thrust_N=np.zeros(len(rows)),
        se_N=np.full(len(rows), float(np.median(like.se_N[~like.tare]))),
        visits=replace(
            like.visits,
            stay=stays_of(conditions, tare, ordered=True),
            zero_s=elapsed,
            tared=np.cumsum(tare),
            tare=tare,
        ),
        power=power,
        name=sweep.name,
        remarks=(),
    )


def speed_at(pulse_us: Array, rig: Rig) -> Array:
    """Return the speed at nominal voltage (m,); 0 without a pulse."""
    p = rig.propulsion
    nominal = p.voltage_nominal_V
    speed = speed_from_pwm(pulse_us, p.speed_per_us_rad_s, p.pwm_start_us, nominal, nominal)
    return np.where(pulse_us > p.pwm_start_us, np.asarray(speed, float), 0.0)


def _visits(sweep: SweepOption, rig: Rig) -> Array:
    """Return pulse, distance, lateral position, time and time since the tare of each row (m, 5)."""
    places = [(z_m, x_m) for x_m, z_m in product(sweep.lateral_m, sweep.distances_m)]
    stays = [(place, sweep.pwm_us) for place in (*places, (rig.plate.z_park_m, 0.0))]
    backwards = [(place, levels[::-1]) for place, levels in reversed(stays)]
    rows: list[tuple[float, ...]] = []
    clock_s = tared_s = 0.0
    for repeat in range(sweep.repeats):
        for (z_m, x_m), levels in backwards if repeat % 2 else stays:
            every_s = 60.0 * sweep.tare_minutes
            if not rows or (every_s and clock_s - tared_s > every_s):
                clock_s += TARE_S
                tared_s = clock_s
                rows.append((0.0, FAR_AWAY_M, 0.0, clock_s, 0.0))
            clock_s += MOVE_S
            for level in levels:
                clock_s += VISIT_S
                rows.append((level, z_m, x_m, clock_s, clock_s - tared_s))
    return np.array(rows)


OPTIONS = (
    SweepOption(
        name="next_distances",
        title="Near and far distances together, two levels",
        reason="offset, neighbours, body lift, blockage and the coefficient grow differently "
        "towards the plate",
        z_over_R=(0.5, 0.65, 0.85, 1.2, 1.7, 2.5, 4.0, 6.5),
        repeats=4,
        tare_minutes=4.0,
    ),
    SweepOption(
        name="next_levels",
        title="Four levels up and down at a near and a far place, a tare every two minutes",
        reason="the zero, its creep, the cell's hysteresis and the exponent differ in how they go "
        "with the level, its order and the time since a tare",
        z_over_R=(1.0, 3.0),
        levels=4,
        repeats=6,
        tare_minutes=2.0,
    ),
    SweepOption(
        name="next_aside",
        title="The plate aside at two distances, discs still over it",
        reason="a tilted plate comes nearer on one side, an offset on both alike",
        z_over_R=(0.75, 1.5),
        aside_over_R=(0.0, 2.0, -2.0),
        repeats=4,
        tare_minutes=4.0,
    ),
    SweepOption(
        name="next_edges",
        title="The plate's edge under the discs at one near distance",
        reason="area factors show where a disc is partly covered, and nowhere else",
        z_over_R=(0.6, 0.9),
        inside_over_R=(-0.4, 0.0, 0.4),
        repeats=2,
        tare_minutes=4.0,
    ),
    SweepOption(
        name="next_long",
        title="Two levels at one place again and again for ten minutes, one tare",
        reason="a battery, a creeping zero and warm air go with the clock and with nothing else",
        z_over_R=(1.0,),
        repeats=24,
    ),
)
"""What is weighed. Distances in both directions and levels up and down in all of them."""


LADDER = SweepOption(
    name="next_pulse_ladder",
    title="A ladder of eight pulses up and down, at a near place and at a far one",
    reason="",
    z_over_R=(0.7, 4.0),
    levels=8,
    repeats=4,
    tare_minutes=4.0,
)
"""For what is unknown between pulse and speed, where places of the plate tell little."""


def next_sweep_experiment(
    evidence: SweepEvidence,
    rivals: Sequence[tuple[str, Array]],
    refused: Subsystem | None = None,
) -> NextExperiment | None:
    """Return the sweep in which the two likeliest rivals differ most.

    Args:
        evidence: that the parameters belong to.
        rivals: effects with the parameters (n_parameters,) of their best fits, likeliest first.
        refused: the stage in which nothing in the library explains what is there.
    """
    if len(rivals) < 2:
        return None
    ladder = refused == "pwm_to_rpm"
    expected: dict[str, float] = {}
    sweeps = {o.name: proposed(o, evidence) for o in ((LADDER,) if ladder else OPTIONS)}
    for name, sweep in sweeps.items():
        log = as_read(points_of(sweep, evidence), evidence, rivals[0][1])
        expected[name] = ratio_of(evidence.of(log), rivals)
    if ladder:
        return NextExperiment.of_speeds(
            rivals, LADDER.title, expected[LADDER.name], plan_toml=sweeps[LADDER.name].toml()
        )
    best = sweeps[max(expected, key=expected.__getitem__)]
    return NextExperiment.between(rivals, expected, best.title, best.reason, plan_toml=best.toml())


def as_read(log: SweepLog, evidence: SweepEvidence, at: Array) -> SweepLog:
    """Return points with what a bench at those parameters (n_parameters,) would read, no noise."""
    sets = at[None, :]
    thrust = evidence.thrusts(log.conditions, sets)[:, 0]
    power = log.power
    if power is not None:
        power = power.at_supply(
            evidence.supply(log, sets)[:, 0], evidence.drive(log, sets)[:, :, 0]
        )
    return replace(log, thrust_N=thrust, power=power)
