"""The seam for physics: what an effect may supply, and what it may see.

An effect is a value. Each hook is a module-level function marked `@expression` (branch-free, so
that the same source serves scalars in a compiled loop, arrays in a fit, and complex steps), or
None, which means that the effect is exactly absent there. A model never calls the hooks of an
effect whose parameters are all fixed at their neutral values.

Hooks see discs, not rotors: coaxial rotors blow through one disc. The disc axis comes first, so
`flow.height_m[i]` is a scalar in a simulator and an array over samples in a fit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, TypeAlias

from benchtool.core.parameter import Parameter
from benchtool.core.rig import Rig
from benchtool.physics.expression import Quantity as Quantity

Stage = Literal["pwm_to_rpm", "rpm_to_thrust", "hinge", "sensor", "plate"]
STAGES: tuple[Stage, ...] = ("pwm_to_rpm", "rpm_to_thrust", "hinge", "sensor", "plate")

BenchKind = Literal["pitch", "sweep"]
BENCH_KINDS: tuple[BenchKind, ...] = ("pitch", "sweep")
"""A beam or vehicle that turns on a hinge, and a plate sweep over a load cell."""


class Flow(NamedTuple):
    """What a hook may see of the bench at one instant, or at many.

    Attributes:
        radius_m: effective rotor radius R: m.
        position_x_m, position_y_m: disc centres (n,): m.
        height_m: distance of each disc to the plate (n, ...): m.
        area: fraction of each disc over the plate (n, ...).
        active: 1 where a disc's rotors turn, else 0 (n, ...).
        speed_rad_s: rotor speed (n, ...); the root of the summed squares on a coaxial disc.
        neighbour_images: upward velocity at each disc from the neighbours' images, per R^2 and own
            induced velocity (n, ...): 1/m2 (eq. 3).
        body_images: the same from all images, at the body's centre (n, ...): 1/m2 (eq. 4).
        body_weight: share of the body lift that the wake rule grants (...).
        voltage_V: battery voltage over nominal is what speed follows (...).
        elapsed_s: time since the last tare (...).
        time_s: time since the run began (...).
        pitch_rad, rate_rad_s: attitude and rate about the y axis (...): rad, rad/s; zero on a bench
            that is held.
        cos_pitch: cosine of the pitch, worked out once for all hooks (...).
        weight_N: weight that the hinge carries (...); zero where nothing hangs on one.
        thrust_N: thrust of each disc (n, ...), for torque hooks; empty elsewhere.
        load_direction: +1 where the load cell's load was approached from below, -1 from above, 0
            where nobody knows (...).
        plate_x_m: lateral position of the plate's centre (...).
    """

    radius_m: Quantity
    position_x_m: Quantity
    position_y_m: Quantity
    height_m: Quantity
    area: Quantity
    active: Quantity
    speed_rad_s: Quantity
    neighbour_images: Quantity
    body_images: Quantity
    body_weight: Quantity
    voltage_V: Quantity
    elapsed_s: Quantity
    time_s: Quantity
    pitch_rad: Quantity = 0.0
    rate_rad_s: Quantity = 0.0
    cos_pitch: Quantity = 1.0
    weight_N: Quantity = 0.0
    thrust_N: Quantity = ()
    load_direction: Quantity = 0.0
    plate_x_m: Quantity = 0.0


Values: TypeAlias = Any
"""The effect's parameters in its own order: p[0] is the first."""

DiscHook = Callable[[int, Flow, Values], Quantity]
"""hook(i, flow, p) -> contribution for disc i."""

ChangeHook = Callable[[int, Quantity, Flow, Values], Quantity]
"""hook(i, quantity, flow, p) -> the quantity of disc i, changed."""

BodyHook = Callable[[Flow, Values], Quantity]
"""hook(flow, p) -> a quantity of the whole body."""

ToleranceHook = Callable[[Rig, BenchKind], Mapping[str, float]]
"""hook(rig, bench) -> tolerance by the parameter's own name, in its unit."""

RigHook = Callable[[Rig], Mapping[str, float]]
"""hook(rig) -> values by the parameter's own name, in its unit."""

ReadingHook = Callable[[Quantity, Flow, Sequence[Quantity], Values], Quantity]
"""hook(reading, flow, states, p) -> the reading, changed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnState:
    """Give an effect memory.

    Attributes:
        name: for people and logs.
        drive: what drives it: "speed_rad_s" (commanded rotor speed) or "none".
        rate: rate(state, drive, p) -> time derivative, with the drive held.
        settled: settled(drive, elapsed_s, p) -> the state on a bench that has been held still:
            fast transients over, slow ones as far as `elapsed_s` since the tare has let them come.
        kept: kept(dt_s, p) -> share of the distance to a held drive that is left after dt_s, where
            the state is a linear lag; simulators then follow it exactly.
        time_constant: the effect's parameter that is the lag's time constant; empty where it has
            none. Below some steps of a simulated plant it cannot be followed.
    """

    name: str
    drive: Literal["speed_rad_s", "none"]
    rate: Callable[[Quantity, Quantity, Values], Quantity]
    settled: Callable[[Quantity, Quantity, Values], Quantity]
    kept: Callable[[Quantity, Values], Quantity] | None = None
    time_constant: str = ""


LAW_ERROR = 0.005
"""Standard error of what an effect does over its departure from neutral, because no bench follows
a law to the letter: a rotor that speeds up is a per cent or two quicker than one that slows down,
an encoder wobbles. Chosen on development records of pitch benches: of 138 intervals 84 % held the
truth without it, 96 % with it, 97 % with twice as much."""


@dataclass(frozen=True, slots=True)
class Derived:
    """Name a quantity and how it follows from free parameters.

    Attributes:
        name: for results ("R_eff_over_R").
        unit: one of `core.units.UNITS`.
        function: function(values by full name) -> quantity, elementwise on arrays; parameters
            that were not free are constants of the function.
    """

    name: str
    unit: str
    function: Callable[[Mapping[str, Any]], Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Effect:
    """Describe one physical effect and supply its part of the physics.

    Attributes:
        name: as in files and on the command line.
        title: for people, three or four words.
        description: what it is, one or two sentences.
        stage: which link of the chain it sits in.
        law: the formula, in plain text.
        parameters: with units, neutral values, default bounds and tolerances.
        shows: where it shows in data.
        source: paper and equation, data sheet, or that it is a guess.
        confused_with: names of effects that look alike, with what separates them.
        benches: on which kinds of bench an explanation may name it; none for effects that are
            there for simulation only.
        adjusted_on: on which kinds of bench every explanation adjusts it within its priors and
            never names it: what an owner knows only roughly.
        separated_by: what to measure so that a fit can tell the effect's first parameter from
            another, by the other's full name ("R_m").
        trends_over: columns over which residuals trend where the effect is missing.
        law_error: standard error of what the effect does on a pitch bench, over its departure
            from neutral.
        supply_loss: the parameter that is the supply's linear loss (1/s), which pulses beside
            speeds and voltage show; empty for none.
        rig_values: values that follow from the rig, for parameters that a model does not state.
        derived: quantities that a fit reports, by full names of the effect's free parameters.
        tolerance_of: tolerances that go with the vehicle's size, for parameters that state none
            themselves; a model file that states one goes first (`tolerances.tolerances`).
        height: change of a disc's distance to the plate, added: m.
        area: a disc's covered fraction, changed: area(i, fraction, flow, p).
        denominator: term of the thrust denominator, added.
        factor: factor of a disc's thrust.
        speed: a disc's rotor speed, changed: speed(i, speed, flow, p).
        torque: torque about the pitch axis: N m, positive nose down as in eq. (9).
        dry_friction: torque that the hinge can hold at rest or opposes to motion: N m, not
            negative; the plant decides between stick and slip.
        dry_width: rate over which dry friction builds up to its full torque: rad/s, not negative;
            0 where it holds at rest.
        random_torque: standard deviation (N m) and correlation time (s) of a random torque about
            the pitch axis, an Ornstein-Uhlenbeck process.
        delay_s: time between a command and its arrival at the motors.
        readings: a channel's reading, changed, by channel name ("thrust_N", "gyro_rad_s").
        states: own states; their values reach the reading hooks in this order, and a state
            driven by speed replaces the speed that the thrust is made of.
        configure: builds the effect for settings in a model file, for example its knots.
    """

    name: str
    title: str
    description: str
    stage: Stage
    law: str
    parameters: tuple[Parameter, ...]
    shows: str
    source: str
    confused_with: Mapping[str, str]
    benches: frozenset[BenchKind] = frozenset(BENCH_KINDS)
    adjusted_on: frozenset[BenchKind] = frozenset()
    separated_by: Mapping[str, str] = field(default_factory=dict)
    trends_over: tuple[str, ...] = ()
    law_error: float = LAW_ERROR
    supply_loss: str = ""
    rig_values: RigHook | None = None
    derived: Callable[[Sequence[str]], Sequence[Derived]] | None = None
    tolerance_of: ToleranceHook | None = None
    height: DiscHook | None = None
    area: ChangeHook | None = None
    denominator: DiscHook | None = None
    factor: DiscHook | None = None
    speed: ChangeHook | None = None
    torque: BodyHook | None = None
    dry_friction: BodyHook | None = None
    dry_width: BodyHook | None = None
    random_torque: Callable[[Values], tuple[Quantity, Quantity]] | None = None
    delay_s: Callable[[Values], Quantity] | None = None
    readings: Mapping[str, ReadingHook] = field(default_factory=dict)
    states: tuple[OwnState, ...] = ()
    configure: Callable[[Mapping[str, Any]], Effect] | None = None

    @property
    def candidate(self) -> bool:
        """Whether an explanation may name it on some bench."""
        return bool(self.benches)

    @property
    def thrust_reading(self) -> ReadingHook | None:
        """The hook on the load cell's reading."""
        return self.readings.get("thrust_N")

    @property
    def changes_geometry(self) -> bool:
        """Whether heights or covered areas, and so the images, depend on its parameters."""
        return self.height is not None or self.area is not None
