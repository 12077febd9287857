"""Sweep plan: settings, order, settling, sampling and tare."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from math import hypot
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tomli_w
from annotated_types import Ge, Gt, Le, Len

from benchtool.core.errors import FileFormatError
from benchtool.core.inputs import Input, Inputs, items
from benchtool.core.toml_text import read_strict
from benchtool.core.user_file import read_library_file

if TYPE_CHECKING:
    from benchtool.core.rig import Rig

Positive = Annotated[float, Gt(0.0), Le(1e6)]
NotNegative = Annotated[float, Ge(0.0), Le(1e6)]
Seconds = Annotated[float, Gt(0.0), Le(3600.0)]  # maximum wait or averaging time; assumed

Distance = Annotated[float, Gt(0.0), Le(1000.0)]
Offset = Annotated[float, Ge(-1000.0), Le(1000.0)]
Tilt = Annotated[float, Ge(-89.0), Le(89.0)]  # limited further by the minimum distance; assumed

Pulse = Annotated[float, Gt(0.0), Le(1e4)]
MAX_LISTED = 1000  # distances, tilts, offsets or levels of a plan; assumed

Distances = Annotated[tuple[Distance, ...], Len(0, MAX_LISTED)]

THROTTLE_TESTS = ("steps", "ramp", "response", "endurance")  # bundled plans without a plate
REPEATS_SINGLE = 9  # tests per distance with one rotor on (paper, section 2.1)
REPEATS_SEVERAL = 5  # tests per distance with the full multirotor (paper, section 2.2)
STANDARD_PERCENT = (40.0, 60.0)  # default throttle levels; assumed
# Default distances, dense where the increment is steep; assumed.
STANDARD_DISTANCES_OVER_R = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlatePart(Inputs):
    """Plate positions: every combination of distance, tilt and lateral position.

    Attributes:
        used: whether the plate is moved; if not, only throttle is varied, with the plate parked
            or absent.
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
            "Plate tilts about the centre; positive: closer to the +x rotors.",
            "deg",
            option="tilt",
            label="Tilts, deg",
        ),
    ] = (0.0,)
    lateral_m: Annotated[
        tuple[Offset, ...],
        Len(1, MAX_LISTED),
        Input(
            "Lateral plate positions along x, for partial coverage.",
            "m",
            option="lateral",
            label="Lateral positions, m",
        ),
    ] = (0.0,)


@dataclass(frozen=True, slots=True, kw_only=True)
class ThrottlePart(Inputs):
    """Throttle levels."""

    TITLE = "Throttle"

    pwm_us: Annotated[
        tuple[Pulse, ...],
        Len(0, MAX_LISTED),
        Input(
            "Pulse widths of the active rotors: 1400,1600.",
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
            "Throttle levels in percent of the allowed pulse range: 20,50,80.",
            option="throttle",
            label="Throttle levels, %",
            instead_of="pwm_us",
        ),
    ] = ()
    rotors_on: Annotated[
        tuple[Annotated[int, Ge(1)], ...],
        Input(
            "Active rotors: 1 or 1,2,3.",
            option="rotors",
            label="Rotors that turn",
            default_text="all",
        ),
    ] = ()
    ramp_s: Annotated[
        float, Ge(0.0), Le(600.0), Input("Ramp time between throttle levels.", "s")
    ] = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderPart(Inputs):
    """Order of the points.

    Attributes:
        kind: "randomised" (plate positions shuffled in every repeat, levels within each position),
            "counterbalanced" (every second repeat backwards), or "as_given".
        references: measure every level with the plate parked in every repeat (T_OGE).
    """

    TITLE = "Order of points"

    kind: Annotated[
        Literal["randomised", "counterbalanced", "as_given"],
        Input("Order of the points.", option="order", label="Order"),
    ] = "randomised"
    seed: Annotated[int, Ge(0), Input("Seed of the order.")] = 0
    references: bool = True
    anchor_every: Annotated[
        int,
        Ge(0),
        Le(1_000_000),
        Input(
            "Points between repeats of an anchor setting, for drift; 0: none.",
            label="Anchor after so many visits (0: never)",
        ),
    ] = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class SettlePart(Inputs):
    """Settling criterion for thrust and speed.

    Attributes:
        slope_per_s: settled if the relative slope is below this, or below twice its standard
            error. 0.002 1/s changes a mean over 2 s by at most 0.2 %; assumed.
        timeout_s: after it the point is measured, marked as not settled, with an event.
    """

    window_s: Seconds = 1.0
    slope_per_s: Positive = 0.002
    timeout_s: Seconds = 15.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TarePart(Inputs):
    """Tare of the load cell.

    Attributes:
        seconds: averaging time of the offset after a tare.
        residual_N: maximum offset; default: from the load cell's zero, noise and quantum.
        every_minutes: interval between tares; 0: only at the start.
        drift_N: change of an anchor that causes a tare; default: off.
        stop_timeout_s: timeout for standstill after zero throttle.
    """

    seconds: Seconds = 1.0
    residual_N: Positive | None = None
    every_minutes: NotNegative = 10.0
    drift_N: Positive | None = None
    stop_timeout_s: Seconds = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CooldownPart(Inputs):
    """Cooldown with motors at zero.

    Attributes:
        above_degC: ESC temperature that starts a cooldown; default: never.
        until_degC: temperature at which the sweep continues.
        below_V: battery voltage under load that starts a cooldown; default: never.
        until_V: voltage without load at which the sweep continues.
        longest_s: timeout after which the sweep stops; it can be resumed.
    """

    above_degC: float | None = None
    until_degC: float = 45.0
    below_V: Positive | None = None
    until_V: NotNegative = 0.0
    longest_s: Annotated[float, Gt(0.0), Le(86400.0)] = 900.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan(Inputs):
    """Plan of a sweep.

    Attributes:
        sample_share: minimum fraction of the expected samples of a point. Assumed: random losses do
            not change a mean, a loss of a fifth is no longer random.
    """

    name: Annotated[str, Input("Name of the run.", group="Run folder")] = "sweep"
    repeats: Annotated[
        Annotated[int, Ge(1), Le(1_000_000_000)] | None,
        Input(
            "Points per setting (paper, section 2).",
            label="Repeats",
            default_text="9 for one active rotor, 5 for several",
            group="Points",
        ),
    ] = None
    sample_s: Annotated[
        Seconds, Input("Averaging window of a point.", "s", label="Samples of a point, s")
    ] = 2.0
    sample_share: Annotated[float, Gt(0.0), Le(1.0)] = 0.8
    plate: PlatePart = PlatePart()
    throttle: ThrottlePart = ThrottlePart()
    order: OrderPart = OrderPart()
    settle: SettlePart = SettlePart()
    tare: TarePart = TarePart()
    rest: CooldownPart = CooldownPart()

    def resolved(self, rig: Rig) -> Plan:
        """Return the plan with all default values filled in for a rig."""
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
    """Return a bundled plan by name, or the plan of a TOML file."""
    return plan_from_toml(*read_library_file("plan", "plans", path))


def plan_from_toml(text: str, where: str) -> Plan:
    """Return the plan of TOML text.

    Raises:
        UnknownChoice: unknown key.
        FileFormatError: wrong type or range, or distances given in two ways.
    """
    plan = read_strict(Plan, text, where)
    values = {item.key: attrgetter(item.key)(plan) for item in items(Plan)}
    for item in items(Plan):
        other = f"{item.key.rpartition('.')[0]}.{item.metadata.instead_of}"
        if values[item.key] and values.get(other):
            raise FileFormatError(where, f"{item.key} and {other} are both given; give one of them")
    return plan


def plan_to_toml(plan: Plan) -> str:
    """Return a plan as TOML text; parsing it gives the same plan."""
    return tomli_w.dumps(_without_empty(asdict(plan)))


def _without_empty(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table without empty values."""
    return {
        key: _without_empty(value) if isinstance(value, Mapping) else value
        for key, value in table.items()
        if value is not None and value != ()
    }


def _pulses_us(rig: Rig, percent: tuple[float, ...]) -> tuple[float, ...]:
    """Return pulses at percentages of the usable pulse range."""
    start_us = rig.propulsion.pwm_start_us
    span_us = min(rig.limits.pwm_us, rig.propulsion.pwm_max_us) - start_us
    return tuple(float(round(start_us + 0.01 * level * span_us)) for level in percent)


def _residual_N(rig: Rig, seconds: float) -> float:
    """Return the maximum tare offset: five standard deviations, or two quanta.

    Exceeded by chance by one tare in 1.7 million. If the rig states no zero, it is at least 0.1 %
    of the thrust limit (assumed).
    """
    sensor = rig.sensors.get("thrust_N")
    floor_N = 0.001 * rig.limits.thrust_N
    if sensor is None:
        return floor_N
    error_N = hypot(sensor.noise / max(1.0, sensor.rate_Hz * seconds) ** 0.5, sensor.zero_sd)
    return float(max(0.0 if sensor.zero_sd else floor_N, 5.0 * error_N, 2.0 * sensor.quantum))
