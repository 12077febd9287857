"""Design of the next plate sweep, to separate rival explanations.

Greedy search: each step adds the distance, lateral position, pulse, repeat, tare or order with the
largest expected reduction of confusion per minute, within the limits of the rig.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import ClassVar

import numpy as np
import tomli_w

from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.explain.engine.design import Designer
from benchtool.explain.sweep.evidence import SweepEvidence
from benchtool.explain.sweep.log import SweepLog
from benchtool.fit.uncertainty.bench_errors import plate_positions
from benchtool.physics.conditions import OUT_OF_GROUND_EFFECT_M, Conditions, load_directions
from benchtool.physics.rotor import speed_from_pwm

VISIT_S, MOVE_S, TARE_S = 5.0, 3.0, 6.0  # level, plate, tare; assumed
MIN_PULSE_SPAN = 0.25  # of levels, over the highest pulse above start; assumed
MAX_LIMIT_SHARE = 0.9  # of the limits on thrust and speed, in a proposed sweep; assumed

# Candidates of a design: distances (below NEAR_Z_OVER_R only if a sweep was as near: laws are least
# certain there), lateral positions (inner discs relative to the plate's edge), pulse levels,
# repeats, and minutes between tares (0 for one at the start); assumed.
Z_OVER_R = (0.5, 0.6, 0.72, 0.9, 1.2, 1.7, 2.5, 4.0, 6.0)
NEAR_Z_OVER_R = 0.6
LATERAL_OVER_R = 2.0
EDGE_OVER_R = (-0.4, 0.0, 0.4)
LEVELS = 4
REPEATS = (2, 4, 6, 8, 12, 16, 24)
TARE_MINUTES = (0.0, 4.0, 2.0)
MINUTES = 15.0  # maximum duration of a proposed sweep; assumed


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepChoices:
    """Settings that a design may have on a rig."""

    rig: Rig
    distances_m: tuple[float, ...]
    lateral_m: tuple[tuple[float, ...], ...]  # sets of positions, each added at once
    pwm_us: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepDesign:
    """Design of a sweep, with the fields of a plan.

    Every second repeat of a counterbalanced one is reversed, so that levels and distances are
    approached from both sides.
    """

    schedule: ClassVar[None] = None
    choices: SweepChoices
    distances_m: tuple[float, ...]
    lateral_m: tuple[float, ...] = (0.0,)
    pwm_us: tuple[float, ...]
    repeats: int = 2
    tare_minutes: float = 0.0  # between tares; 0 for one at the start
    counterbalanced: bool = True

    @property
    def plan_toml(self) -> str:
        """Plan for `benchtool sweep --plan`."""
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

    @property
    def duration_s(self) -> float:
        return float(self.visits()[-1, 3])

    def visits(self) -> Array:
        """Return pulse, distance, lateral position, time and time since the tare (m, 5)."""
        parked = (self.choices.rig.plate.z_park_m, 0.0)
        positions = [(z_m, x_m) for x_m, z_m in product(self.lateral_m, self.distances_m)]
        stays = [(position, self.pwm_us) for position in (*positions, parked)]
        reverse = [(position, levels[::-1]) for position, levels in reversed(stays)]
        rows: list[tuple[float, ...]] = []
        clock_s = tared_s = 0.0
        for repeat in range(self.repeats):
            for (z_m, x_m), levels in reverse if repeat % 2 and self.counterbalanced else stays:
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

    @property
    def title(self) -> str:
        radius_m = self.choices.rig.propulsion.radius_m
        ratios = ", ".join(f"{z_m / radius_m:.2g}" for z_m in self.distances_m)
        lateral = ", ".join(f"{1e3 * x_m:.0f}" for x_m in self.lateral_m)
        pulses = ", ".join(f"{pulse:g}" for pulse in self.pwm_us)
        positions = f", lateral positions {lateral} mm" if len(self.lateral_m) > 1 else ""
        tares = f", a tare every {self.tare_minutes:g} minutes" if self.tare_minutes else ""
        order = ", every second time in reverse order" if self.counterbalanced else ""
        repeats = f"{self.repeats} times{order}{tares}"
        return f"A sweep at z/R {ratios}{positions}, {pulses} us, {repeats}"

    def extend(self) -> dict[str, SweepDesign]:
        choices, designs = self.choices, dict[str, SweepDesign]()
        for z_m in set(choices.distances_m) - set(self.distances_m):
            distances = tuple(sorted((*self.distances_m, z_m)))
            designs[f"distance {z_m}"] = replace(self, distances_m=distances)
        for positions in choices.lateral_m:
            if positions[0] not in self.lateral_m:
                lateral = (*self.lateral_m, *positions)
                designs[f"aside {positions[0]}"] = replace(self, lateral_m=lateral)
        for pulse in set(choices.pwm_us) - set(self.pwm_us):
            pulses = tuple(sorted((*self.pwm_us, pulse)))
            designs[f"pulse {pulse}"] = replace(self, pwm_us=pulses)
        for repeats in REPEATS:
            if repeats > self.repeats:
                designs["repeats"] = replace(self, repeats=repeats)
                break
        for minutes in set(TARE_MINUTES) - {self.tare_minutes}:
            designs[f"tare {minutes}"] = replace(self, tare_minutes=minutes)
        designs["order"] = replace(self, counterbalanced=not self.counterbalanced)
        return designs


def plan_points(design: SweepDesign, evidence: SweepEvidence) -> SweepLog:
    """Return the points of a planned sweep, with speeds of the model and no thrust yet."""
    rig = evidence.model.rig
    rows = design.visits()
    tare = rows[:, 0] == 0.0
    pulse, z_m, x_m, time, elapsed = rows.T
    speed = speed_at(pulse, rig)
    position = np.array([z_m, x_m, np.zeros(len(rows))])
    reference = evidence.logs[0]
    conditions = Conditions.build(
        rig,
        speed_rad_s=np.broadcast_to(speed, (rig.n_rotors, len(rows))),
        plate_z_m=z_m,
        plate_x_m=x_m,
        elapsed_s=elapsed,
        time_s=time,
        load_direction=load_directions(time, elapsed, position, speed**2),
        speed_measured=reference.conditions.speed_measured,
    )
    power = None
    if reference.power is not None:
        power = reference.power.planned(time[~tare], pulse[~tare], speed[~tare])
    return replace(
        reference,
        conditions=conditions,
        thrust_N=np.zeros(len(rows)),
        se_N=np.full(len(rows), float(np.median(reference.se_N[~reference.tare]))),
        visits=replace(
            reference.visits,
            stay=plate_positions(conditions, tare, ordered=True),
            zero_s=elapsed,
            tared=np.cumsum(tare),
            tare=tare,
            rounded=np.full(len(rows), np.median(reference.visits.rounded) > 0.0),
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
    return np.asarray(speed, float)


def predict_readings(log: SweepLog, evidence: SweepEvidence, values: Array) -> SweepLog:
    """Return points with noise-free readings of a bench with these parameters (n_parameters,)."""
    sets = values[None, :]
    thrust = evidence.thrusts(log.conditions, sets)[:, 0]
    power = log.power
    if power is not None:
        supply, drive = evidence.supply(log, sets), evidence.drive(log, sets)
        power = replace(
            power,
            speed_rad_s=power.speed_rad_s * drive[:, :, 0].mean(axis=0),
            rotor_rad_s=power.rotor_rad_s * drive[:, :, 0],
            voltage_V=power.voltage_V * supply[:, 0],
        )
    return replace(log, thrust_N=thrust, power=power)


class SweepDesigner(Designer[SweepDesign]):
    """Search for the next sweep, within the rig's limits and the range of pulses swept."""

    max_minutes = MINUTES
    evidence: SweepEvidence

    def initial(self, *, ladder: bool) -> SweepDesign:
        """Return the initial design: two distances, and two levels or all of them."""
        choices = self._choices()
        distances, levels = choices.distances_m, choices.pwm_us
        far = distances[-2 if len(distances) > 1 else -1]
        return SweepDesign(
            choices=choices,
            distances_m=tuple(dict.fromkeys((distances[0], far))),
            pwm_us=levels if ladder else (levels[0], levels[-1]),
        )

    def simulate(self, design: SweepDesign) -> tuple[SweepEvidence, SweepEvidence]:
        log = predict_readings(plan_points(design, self.evidence), self.evidence, self.values)
        new = self.evidence.of(log)
        return new, self.evidence.with_other(new)

    def _choices(self) -> SweepChoices:
        evidence, rig = self.evidence, self.evidence.model.rig
        p, radius_m = rig.propulsion, rig.propulsion.radius_m
        nearest_m = min(float(log.conditions.plate_z_m.min()) for log in evidence.logs)
        nearest_m = max(rig.plate.z_min_m, min(nearest_m, NEAR_Z_OVER_R * radius_m))
        heights = [ratio * radius_m for ratio in Z_OVER_R]
        distances = [round(z_m, 4) for z_m in heights if nearest_m <= z_m < rig.plate.z_park_m]
        sides = [LATERAL_OVER_R * radius_m]
        sides += [0.5 * rig.plate.size_x_m - offset * radius_m for offset in EDGE_OVER_R]
        lateral = [round(x_m, 4) for x_m in sides if 0.0 < x_m <= rig.plate_x_max_m]
        swept = [log.power.pulse_us for log in evidence.logs if log.power is not None]
        if swept:
            pulses = np.concatenate(swept)
            low, high = float(pulses.min()), float(pulses.max())
        else:
            span = min(p.pwm_max_us, rig.limits.pwm_us) - p.pwm_start_us
            low, high = p.pwm_start_us + 0.4 * span, p.pwm_start_us + 0.6 * span
        choices = SweepChoices(
            rig=rig,
            distances_m=tuple(distances) or (round(2.0 * rig.plate.z_min_m, 4),),
            lateral_m=tuple((x_m, -x_m) for x_m in dict.fromkeys(lateral)),
        )
        limit_N = MAX_LIMIT_SHARE * min(rig.limits.thrust_N, rig.limits.load_cell_rating_N)
        limit_rad_s = MAX_LIMIT_SHARE * rig.limits.rpm * np.pi / 30.0
        nominal = np.zeros((1, len(evidence.parameters)))
        high = min(high, rig.limits.pwm_us)
        once = SweepDesign(
            choices=choices, distances_m=choices.distances_m, pwm_us=(high,), repeats=1
        )
        while True:  # all distances at the highest pulse
            conditions = plan_points(replace(once, pwm_us=(high,)), evidence).conditions
            max_N = float(evidence.thrusts(conditions, nominal).max())
            if max_N <= limit_N and float(conditions.speed_rad_s.max()) <= limit_rad_s:
                break
            high = p.pwm_start_us + 0.95 * (high - p.pwm_start_us)
        low = min(low, high - MIN_PULSE_SPAN * (high - p.pwm_start_us))
        levels = np.linspace(low, high, LEVELS).round()
        return replace(choices, pwm_us=tuple(float(level) for level in dict.fromkeys(levels)))
