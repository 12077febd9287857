"""Design the next plate sweep: the one that is expected to say most between rival explanations.

Distances, lateral positions, pulses, repeats, tares and order are added one after the other, each
time what lowers the expected confusion most for its minutes, within the limits of the rig.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import tomli_w

from benchtool.core.array_type import Array
from benchtool.core.rig import Rig
from benchtool.explain.engine.design import ExpectedOutcome, Forecast, proposal, select_design
from benchtool.explain.engine.judgement import CandidateEffect
from benchtool.explain.engine.verdict import NextExperiment
from benchtool.explain.sweep.evidence import SweepEvidence
from benchtool.explain.sweep.log import SweepLog
from benchtool.fit.uncertainty.bench_errors import plate_positions
from benchtool.physics.conditions import OUT_OF_GROUND_EFFECT_M, Conditions, load_directions
from benchtool.physics.effects.effect import Subsystem
from benchtool.physics.rotor import speed_from_pwm

VISIT_S, MOVE_S, TARE_S = 5.0, 3.0, 6.0  # level, plate, tare; assumed
LEAST_SPAN = 0.25  # of the greatest pulse past the start, over which levels spread; assumed
ROOM = 0.9  # share of the limits on thrust and speed that a proposed sweep goes to; assumed

Z_OVER_R = (0.5, 0.6, 0.72, 0.9, 1.2, 1.7, 2.5, 4.0, 6.0)
NEAR_Z_OVER_R = 0.6
ASIDE_OVER_R = 2.0
INSIDE_OVER_R = (-0.4, 0.0, 0.4)
LEVELS = 4
REPEATS = (2, 4, 6, 8, 12, 16, 24)
TARE_MINUTES = (0.0, 4.0, 2.0)
"""What a design is chosen from: distances, those below the second only where a sweep was as near
before, since laws are least sure there; lateral positions, the discs still over the plate or its
edge so far within the middle discs' axes; pulse levels; visits of each setting; minutes between
tares, 0 for one at the start. Choices."""

MINUTES = 15.0  # longest sweep that is proposed; assumed


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepDesign:
    """Describe a sweep in the terms of a plan.

    Every second repeat of a counterbalanced one goes backwards, so that levels and distances are
    approached from both sides.
    """

    distances_m: tuple[float, ...]
    lateral_m: tuple[float, ...]
    pwm_us: tuple[float, ...]
    repeats: int = 2
    tare_minutes: float = 0.0  # between tares; 0 for one at the start
    counterbalanced: bool = True

    def toml(self) -> str:
        """Return the plan that `benchtool sweep --plan` reads."""
        return tomli_w.dumps(
            {
                "name": "next_sweep",
                "repeats": self.repeats,
                "plate": {"distances_m": self.distances_m, "lateral_m": self.lateral_m},
                "throttle": {"pwm_us": self.pwm_us},
                "order": {
                    "kind": "counterbalanced" if self.counterbalanced else "as_given",
                    "references": True,
                    "anchor_every": 0,
                },
                "tare": {"every_minutes": self.tare_minutes},
            }
        )

    def duration_s(self, rig: Rig) -> float:
        """Return how long it takes."""
        return float(self.visits(rig)[-1, 3])

    def visits(self, rig: Rig) -> Array:
        """Return pulse, distance, lateral position, time and time since the tare (m, 5)."""
        places = [(z_m, x_m) for x_m, z_m in product(self.lateral_m, self.distances_m)]
        stays = [(place, self.pwm_us) for place in (*places, (rig.plate.z_park_m, 0.0))]
        backwards = [(place, levels[::-1]) for place, levels in reversed(stays)]
        rows: list[tuple[float, ...]] = []
        clock_s = tared_s = 0.0
        for repeat in range(self.repeats):
            for (z_m, x_m), levels in backwards if repeat % 2 and self.counterbalanced else stays:
                every_s = 60.0 * self.tare_minutes
                if not rows or (every_s and clock_s - tared_s > every_s):
                    clock_s += TARE_S
                    tared_s = clock_s
                    rows.append((0.0, OUT_OF_GROUND_EFFECT_M, 0.0, clock_s, 0.0))
                clock_s += MOVE_S
                for level in levels:
                    clock_s += VISIT_S
                    rows.append((level, z_m, x_m, clock_s, clock_s - tared_s))
        return np.array(rows)

    def text(self, radius_m: float) -> str:
        """Say what is done."""
        ratios = ", ".join(f"{z_m / radius_m:.2g}" for z_m in self.distances_m)
        aside = ", ".join(f"{1e3 * x_m:.0f}" for x_m in self.lateral_m)
        pulses = ", ".join(f"{pulse:g}" for pulse in self.pwm_us)
        moved = f", the plate at {aside} mm" if len(self.lateral_m) > 1 else ""
        tares = f", a tare every {self.tare_minutes:g} minutes" if self.tare_minutes else ""
        back = ", every second time backwards" if self.counterbalanced else ""
        return f"A sweep at z/R {ratios}{moved}, {pulses} us, {self.repeats} times{back}{tares}"


def points_of(design: SweepDesign, evidence: SweepEvidence) -> SweepLog:
    """Return the points that a sweep would visit, thrust and speeds still those of the model."""
    rig = evidence.model.rig
    rows = design.visits(rig)
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
            stay=plate_positions(conditions, tare, ordered=True),
            zero_s=elapsed,
            tared=np.cumsum(tare),
            tare=tare,
            rounded=np.full(len(rows), np.median(like.visits.rounded) > 0.0),
        ),
        power=power,
        name="the next sweep",
        remarks=(),
    )


def speed_at(pulse_us: Array, rig: Rig) -> Array:
    """Return the speed at nominal voltage (m,); 0 without a pulse."""
    p = rig.propulsion
    nominal = p.voltage_nominal_V
    speed = speed_from_pwm(pulse_us, p.speed_per_us_rad_s, p.pwm_start_us, nominal, nominal)
    return np.where(pulse_us > p.pwm_start_us, np.asarray(speed, float), 0.0)


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


@dataclass(frozen=True, slots=True, kw_only=True)
class _Reach:
    """Hold what a design on a rig is chosen from."""

    distances_m: tuple[float, ...]
    lateral_m: tuple[tuple[float, ...], ...]  # each set of positions is added as one
    pwm_us: tuple[float, ...]

    @classmethod
    def of(cls, evidence: SweepEvidence) -> _Reach:
        """Return what the rig's limits allow, pulses over the range that was swept."""
        rig = evidence.model.rig
        p, radius_m = rig.propulsion, rig.propulsion.radius_m
        nearest_m = min(float(one.conditions.plate_z_m.min()) for one in evidence.logs)
        nearest_m = max(rig.plate.z_min_m, min(nearest_m, NEAR_Z_OVER_R * radius_m))
        distances = [
            round(ratio * radius_m, 4)
            for ratio in Z_OVER_R
            if nearest_m <= ratio * radius_m < rig.plate.z_park_m
        ]
        sides = [ASIDE_OVER_R * radius_m]
        sides += [0.5 * rig.plate.size_x_m - inside * radius_m for inside in INSIDE_OVER_R]
        lateral = [round(x_m, 4) for x_m in sides if 0.0 < x_m <= rig.plate_x_max_m]
        seen = [one.power.pulse_us for one in evidence.logs if one.power is not None]
        if seen:
            pulses = np.concatenate(seen)
            low, high = float(pulses.min()), float(pulses.max())
        else:
            span = min(p.pwm_max_us, rig.limits.pwm_us) - p.pwm_start_us
            low, high = p.pwm_start_us + 0.4 * span, p.pwm_start_us + 0.6 * span
        reach = cls(
            distances_m=tuple(distances) or (round(2.0 * rig.plate.z_min_m, 4),),
            lateral_m=tuple((x_m, -x_m) for x_m in dict.fromkeys(lateral)),
            pwm_us=(),
        )
        limit_N = ROOM * min(rig.limits.thrust_N, rig.limits.load_cell_rating_N)
        limit_rad_s = ROOM * rig.limits.rpm * np.pi / 30.0
        here = np.zeros((1, len(evidence.parameters)))
        high = min(high, rig.limits.pwm_us)
        while True:
            full = points_of(reach.whole(high), evidence).conditions
            most_N = float(evidence.thrusts(full, here).max())
            if most_N <= limit_N and float(full.speed_rad_s.max()) <= limit_rad_s:
                break
            high = p.pwm_start_us + 0.95 * (high - p.pwm_start_us)
        low = min(low, high - LEAST_SPAN * (high - p.pwm_start_us))
        levels = np.linspace(low, high, LEVELS).round()
        return replace(reach, pwm_us=tuple(float(one) for one in dict.fromkeys(levels)))

    def whole(self, pulse_us: float) -> SweepDesign:
        """Return every place at one pulse, once."""
        return SweepDesign(
            distances_m=self.distances_m, lateral_m=(0.0,), pwm_us=(pulse_us,), repeats=1
        )

    def first(self, *, ladder: bool) -> SweepDesign:
        """Return the design that others begin with: two distances, two levels or all of them."""
        near, far = self.distances_m[0], self.distances_m[-2 if len(self.distances_m) > 1 else -1]
        return SweepDesign(
            distances_m=tuple(dict.fromkeys((near, far))),
            lateral_m=(0.0,),
            pwm_us=self.pwm_us if ladder else (self.pwm_us[0], self.pwm_us[-1]),
        )

    def more(self, design: SweepDesign) -> dict[str, SweepDesign]:
        """Return every design with one thing more, or changed in how it is ordered, by that."""
        found = {}
        for z_m in set(self.distances_m) - set(design.distances_m):
            distances = tuple(sorted((*design.distances_m, z_m)))
            found[f"distance {z_m}"] = replace(design, distances_m=distances)
        for sides in self.lateral_m:
            if sides[0] not in design.lateral_m:
                lateral = (*design.lateral_m, *sides)
                found[f"aside {sides[0]}"] = replace(design, lateral_m=lateral)
        for pulse in set(self.pwm_us) - set(design.pwm_us):
            pulses = tuple(sorted((*design.pwm_us, pulse)))
            found[f"pulse {pulse}"] = replace(design, pwm_us=pulses)
        for repeats in REPEATS:
            if repeats > design.repeats:
                found["repeats"] = replace(design, repeats=repeats)
                break
        for minutes in set(TARE_MINUTES) - {design.tare_minutes}:
            found[f"tare {minutes}"] = replace(design, tare_minutes=minutes)
        found["order"] = replace(design, counterbalanced=not design.counterbalanced)
        return found


def next_sweep(
    evidence: SweepEvidence,
    rivals: Sequence[CandidateEffect],
    rng: np.random.Generator,
    refused: Subsystem | None = None,
    minutes: float | None = None,
) -> NextExperiment:
    """Return the sweep that is expected to separate two rivals or more."""
    forecast = Forecast(evidence, rivals)
    rig = evidence.model.rig

    def weighed(design: SweepDesign, drawn: np.random.Generator | None = None) -> ExpectedOutcome:
        log = as_read(points_of(design, evidence), evidence, forecast.rivals[0].fit.values)
        new = evidence.of(log)
        return forecast.expected(new, evidence.with_other(new), drawn)

    reach = _Reach.of(evidence)
    best = select_design(
        reach.first(ladder=refused == "pwm_to_rpm"),
        reach.more,
        weighed,
        lambda design: design.duration_s(rig),
        60.0 * min(minutes or MINUTES, MINUTES),
    )
    return proposal(
        forecast.rivals,
        weighed(best, rng),
        best.text(rig.propulsion.radius_m),
        best.duration_s(rig),
        refused,
        plan_toml=best.toml(),
    )
