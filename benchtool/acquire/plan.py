"""A sweep's plan: what is visited, how it is ordered, how settled, sampled and tared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from math import hypot
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tomli_w
from annotated_types import Ge, Gt, Le, Len

from benchtool.core.errors import FileFormatError
from benchtool.core.inputs import Input, Inputs
from benchtool.core.library import read_named
from benchtool.core.toml_text import read_strict

if TYPE_CHECKING:
    from benchtool.core.rig import Rig

Positive = Annotated[float, Gt(0.0), Le(1e6)]
NotNegative = Annotated[float, Ge(0.0), Le(1e6)]
Seconds = Annotated[float, Gt(0.0), Le(3600.0)]  # no wait or average takes longer; assumed

Distance = Annotated[float, Gt(0.0), Le(1000.0)]
Offset = Annotated[float, Ge(-1000.0), Le(1000.0)]
Tilt = Annotated[float, Ge(-89.0), Le(89.0)]  # the minimum distance allows far less; assumed

Pulse = Annotated[float, Gt(0.0), Le(1e4)]
MAX_LISTED = 1000  # most distances, tilts, offsets or levels of a plan; assumed

Distances = Annotated[tuple[Distance, ...], Len(0, MAX_LISTED)]

THROTTLE_TESTS = ("steps", "ramp", "response", "endurance")  # shipped plans without a plate
REPEATS_SINGLE = 9  # tests per distance with one rotor on (paper, section 2.1)
REPEATS_SEVERAL = 5  # tests per distance with the full multirotor (paper, section 2.2)
STANDARD_PERCENT = (40.0, 60.0)  # throttle levels of a plan that names none; assumed

# Assumed: dense where the increment is steep.
STANDARD_DISTANCES_OVER_R = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlatePart(Inputs):
    """Say where the plate goes: every combination of distance, tilt and lateral position.

    Attributes:
        used: whether distances are visited; without, throttle alone is, far from any surface: the
            plate is parked where the bench moves one, and away where it does not.
    """

    TITLE = "Plate"

    used: bool = True

    distances_m: Annotated[
        Distances,
        Input(
            "Plate distances from the rotor plane: 0.06,0.12,0.24.",
            "m",
            option="z_m",
            instead_of="distances_over_R",
        ),
    ] = ()
    distances_over_R: Annotated[
        Distances,
        Input(
            "Plate distances in rotor radii: 0.5,1,2.",
            option="z_over_r",
            label="Plate distances, z/R",
            default_text="0.5 to 5 within the travel",
            instead_of="distances_m",
        ),
    ] = ()
    tilts_deg: Annotated[
        tuple[Tilt, ...],
        Len(1, MAX_LISTED),
        Input(
            "Plate inclinations about its centre; positive brings +x rotors nearer.",
            "deg",
            option="tilt",
            label="Tilts, deg",
        ),
    ] = (0.0,)
    lateral_m: Annotated[
        tuple[Offset, ...],
        Len(1, MAX_LISTED),
        Input(
            "Plate positions along x, for partial coverage.",
            "m",
            option="lateral",
            label="Lateral positions, m",
        ),
    ] = (0.0,)


@dataclass(frozen=True, slots=True, kw_only=True)
class ThrottlePart(Inputs):
    """Say how fast the rotors turn."""

    TITLE = "Throttle"

    pwm_us: Annotated[
        tuple[Pulse, ...],
        Len(0, MAX_LISTED),
        Input(
            "Pulse levels, each given to every rotor that is on: 1400,1600.",
            "us",
            option="pwm",
            label="Pulses, us",
            default_text="40 % and 60 % of the pulse range",
            instead_of="percent",
        ),
    ] = ()
    percent: Annotated[
        tuple[Annotated[float, Gt(0.0), Le(100.0)], ...],
        Len(0, MAX_LISTED),
        Input(
            "Throttle levels in percent of the pulse range that the rig's limits allow: 20,50,80.",
            option="throttle",
            label="Throttle levels, %",
            instead_of="pwm_us",
        ),
    ] = ()
    rotors_on: Annotated[
        tuple[Annotated[int, Ge(1)], ...],
        Input(
            "Rotors that turn: 1 or 1,2,3.",
            option="rotors",
            label="Rotors that turn",
            default_text="all",
        ),
    ] = ()
    ramp_s: Annotated[float, Ge(0.0), Le(600.0), Input("Time from one level to the next.", "s")] = (
        0.3
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderPart(Inputs):
    """Say in which order settings are visited.

    Attributes:
        kind: "randomised" (plate positions shuffled in every repeat, levels within each position),
            "counterbalanced" (every second repeat backwards), or "as_given".
        references: visit every level with the plate parked in every repeat (T_OGE).
    """

    TITLE = "Order of the visits"

    kind: Annotated[
        Literal["randomised", "counterbalanced", "as_given"],
        Input("Order of the visits.", option="order", label="Order"),
    ] = "randomised"
    seed: Annotated[int, Ge(0), Input("Seed of the order.")] = 0
    references: bool = True
    anchor_every: Annotated[
        int,
        Ge(0),
        Le(1_000_000),
        Input(
            "Repeat one setting after so many visits, to see drift; 0: never.",
            label="Anchor after so many visits (0: never)",
        ),
    ] = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class SettlePart(Inputs):
    """Say when thrust and speed count as settled.

    Attributes:
        slope_per_s: settled when the slope over the mean is below this, or below twice its
            standard error. 0.002 1/s moves a mean over 2 s by 0.2 % at most; a choice.
        timeout_s: after so long the point is taken anyway, marked unsettled, with an event.
    """

    window_s: Seconds = 1.0
    slope_per_s: Positive = 0.002
    timeout_s: Seconds = 15.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TarePart(Inputs):
    """Say when and how well the load cell is tared.

    Attributes:
        seconds: span over which the rest is averaged after a tare.
        residual_N: largest rest; from the load cell's zero, noise and quantum when left out.
        every_minutes: tare again after so long; 0 for only at the start.
        drift_N: tare again when an anchor has moved by more; off when left out.
        stop_timeout_s: rotors must stand still so soon after zero was commanded.
    """

    seconds: Seconds = 1.0
    residual_N: Positive | None = None
    every_minutes: NotNegative = 10.0
    drift_N: Positive | None = None
    stop_timeout_s: Seconds = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CooldownPart(Inputs):
    """Say when the bench rests with motors at zero.

    Attributes:
        above_degC: ESC temperature above which it rests; never when left out.
        until_degC: temperature at which the sweep goes on.
        below_V: pack voltage under load below which it rests; never when left out.
        until_V: voltage at rest at which the sweep goes on.
        longest_s: after so long the sweep stops; it can be resumed.
    """

    above_degC: float | None = None
    until_degC: float = 45.0
    below_V: Positive | None = None
    until_V: NotNegative = 0.0
    longest_s: Annotated[float, Gt(0.0), Le(86400.0)] = 900.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan(Inputs):
    """Hold everything that a sweep shall do.

    Attributes:
        sample_share: of the samples that this span should bring, a point needs so many. A choice:
            what is lost at random moves no mean, a loss of a fifth is no longer at random.
    """

    name: Annotated[str, Input("Name of the run.", group="Run folder")] = "sweep"
    repeats: Annotated[
        Annotated[int, Ge(1), Le(1_000_000_000)] | None,
        Input(
            "Visits of each setting (paper, section 2).",
            label="Repeats",
            default_text="9 for one rotor on, 5 for several",
            group="Points",
        ),
    ] = None
    sample_s: Annotated[
        Seconds, Input("Span of the samples of a point.", "s", label="Samples of a point, s")
    ] = 2.0
    sample_share: Annotated[float, Gt(0.0), Le(1.0)] = 0.8
    plate: PlatePart = PlatePart()
    throttle: ThrottlePart = ThrottlePart()
    order: OrderPart = OrderPart()
    settle: SettlePart = SettlePart()
    tare: TarePart = TarePart()
    rest: CooldownPart = CooldownPart()

    def resolved(self, rig: Rig) -> Plan:
        """Return the plan with every number that it left open filled in for a rig."""
        plate = self.plate
        radius_m = rig.propulsion.radius_m
        if plate.used and not plate.distances_m:
            ratios = plate.distances_over_R or tuple(
                ratio
                for ratio in STANDARD_DISTANCES_OVER_R
                if rig.plate.z_min_m <= ratio * radius_m < rig.plate.z_park_m
            )
            distances_m = tuple(round(ratio * radius_m, 9) for ratio in ratios)
            plate = replace(plate, distances_m=distances_m, distances_over_R=())
        rotors = self.throttle.rotors_on or tuple(range(1, rig.n_rotors + 1))
        pwm_us = self.throttle.pwm_us or _pulses_us(rig, self.throttle.percent or STANDARD_PERCENT)
        throttle = replace(self.throttle, pwm_us=pwm_us, percent=(), rotors_on=rotors)
        repeats = self.repeats or (REPEATS_SINGLE if len(rotors) == 1 else REPEATS_SEVERAL)
        residual_N = self.tare.residual_N or _residual_N(rig, self.tare.seconds)
        tare = replace(self.tare, residual_N=residual_N)
        return replace(self, repeats=repeats, plate=plate, throttle=throttle, tare=tare)


def read_plan(path: str | Path) -> Plan:
    """Return a shipped plan by its name, or the plan in a TOML file.

    Raises:
        UnknownChoice: a name that is neither.
        FileFormatError: see `plan_from_toml`.
    """
    return plan_from_toml(*read_named("plan", "plans", path))


def plan_from_toml(text: str, where: str) -> Plan:
    """Return the plan that TOML text describes.

    Raises:
        UnknownChoice: a key that a plan has not, with the known ones.
        FileFormatError: a value of the wrong type or range, or distances given twice.
    """
    plan = read_strict(Plan, text, where)
    if plan.plate.distances_m and plan.plate.distances_over_R:
        raise FileFormatError(
            where, "plate.distances_m and plate.distances_over_R are both given; give one of them"
        )
    if plan.throttle.pwm_us and plan.throttle.percent:
        raise FileFormatError(
            where, "throttle.pwm_us and throttle.percent are both given; give one of them"
        )
    return plan


def plan_to_toml(plan: Plan) -> str:
    """Return a plan as TOML text that reads back to the same plan."""
    return tomli_w.dumps(_stated(asdict(plan)))


def _stated(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table without what it leaves open."""
    return {
        key: _stated(value) if isinstance(value, Mapping) else value
        for key, value in table.items()
        if value is not None and value != ()
    }


def _pulses_us(rig: Rig, percent: tuple[float, ...]) -> tuple[float, ...]:
    """Return pulses at percentages of the usable pulse range."""
    start_us = rig.propulsion.pwm_start_us
    span_us = min(rig.limits.pwm_us, rig.propulsion.pwm_max_us) - start_us
    return tuple(float(round(start_us + 0.01 * each * span_us)) for each in percent)


def _residual_N(rig: Rig, seconds: float) -> float:
    """Return five standard deviations of a tare's rest by the rig's zero and noise, or two quanta.

    One tare in 1.7 million leaves more by chance. Where the rig states no zero, the limit is at
    least 0.1 % of the thrust limit, which is assumed.
    """
    sensor = rig.sensors.get("thrust_N")
    floor_N = 0.001 * rig.limits.thrust_N
    if sensor is None:
        return floor_N
    error_N = hypot(sensor.noise / max(1.0, sensor.rate_Hz * seconds) ** 0.5, sensor.zero_sd)
    return float(max(0.0 if sensor.zero_sd else floor_N, 5.0 * error_N, 2.0 * sensor.quantum))
