"""The seam for physics: what an effect may supply, and what it may see.

An effect is a value: numbers, hooks and knowledge. A hook is a module-level function marked
`@expression` (branch-free, so that the same source serves scalars in a compiled loop, arrays in a
fit, and complex steps), or None, which means that the effect is exactly absent there. A model never
calls the hooks of an effect whose parameters are all fixed at their neutral values.

Hooks see discs, not rotors: coaxial rotors blow through one disc. The disc axis comes first, so
`flow.height_m[i]` is a scalar in a simulator and an array over samples in a fit.
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cache
from math import inf
from typing import Any, Literal, NamedTuple

from benchtool.core.errors import InputError
from benchtool.core.parameter import Parameter, Prior
from benchtool.core.rig import Rig
from benchtool.physics.distance_law import DistanceLaw
from benchtool.physics.expression import Quantity as Quantity
from benchtool.physics.expression import expression as expression
from benchtool.physics.tilt import LEVEL

Subsystem = Literal["pwm_to_rpm", "rpm_to_thrust", "hinge", "sensor", "plate"]
SUBSYSTEMS: tuple[Subsystem, ...] = ("pwm_to_rpm", "plate", "rpm_to_thrust", "hinge", "sensor")
"""The links of the chain from pulse width to reading, in order."""

BenchKind = Literal["pitch", "sweep"]
BENCH_KINDS: tuple[BenchKind, ...] = ("pitch", "sweep")  # body on a hinge; plate over a load cell

LAW_ERROR = 0.005
"""Standard error of what an effect does over its departure from neutral, because no bench follows
a law to the letter: a rotor that speeds up is a per cent or two quicker than one that slows down,
an encoder wobbles. Chosen on development records of pitch benches: of 138 intervals 84 % held the
truth without it, 96 % with it, 97 % with twice as much."""


class Flow(NamedTuple):
    """What a hook may see of the bench at one instant, or at many.

    First what stays; from `height_m` on what effects on heights and the images change; then what
    changes within a step.

    Attributes:
        radius_m: effective rotor radius R: m.
        position_x_m, position_y_m: disc centres (n,): m.
        active: 1 where a disc's rotors turn, else 0 (n, ...).
        speed_rad_s: rotor speed (n, ...); the root of the summed squares on a coaxial disc.
        pitch_rad: attitude about the y axis (...): rad; zero on a bench that is held.
        cos_pitch: share of `weight_N` along the body's own vertical (...): the cosine of the pitch
            on a hinge, 1 in flight.
        weight_N: weight that the hinge carries (...), in flight the rotors' thrust, which carries
            it along the body's own vertical; zero where nothing turns.
        load_direction: +1 where the load cell's load was approached from below, -1 from above, 0
            where nobody knows (...).
        airspeed_m_s: horizontal speed of the rotors through the air (...): m/s.
        acceleration_rad_s2: of the pitch, where a gyro is read (...).
        height_m: distance of each disc to the surface (n, ...): m.
        coverage: fraction of each disc over the surface (n, ...).
        neighbour_images: velocity against each disc's inflow from the neighbours' images, per R^2
            and own induced velocity (n, ...): 1/m2 (eq. 3).
        body_images: the same from all images, at the body's centre (n, ...): 1/m2 (eq. 4); one
            number for all discs, unless the tilt rule has it at each rotor's height.
        body_weight: share of the body lift that the wake rule grants (...).
        plane: the surface under the rotor plane, a `Plane` (...).
        axial_share: what counts of the velocity from a rotor's own image (...): the cosine of the
            angle between the rotor axis and the surface's normal, or 1 (`tilt`). The term of
            a law of thrust against distance is multiplied with it in the sum.
        rate_rad_s: rate about the y axis (...): rad/s; zero on a bench that is held.
        thrust_N: thrust of each disc (n, ...), for torque hooks; empty elsewhere.
        moved_s: time since the plate last moved (...); 0 where nobody knows.
        moved_direction: +1 where the plate came to its distance from nearer, -1 from farther, 0
            where nobody knows (...).
        past_load: summed squared speed over the greatest of the run, as a mean over the past that
            forgets within each of `PAST_S` (4, ...); 0 where nobody knows.
        past_wash: the same of the load times what of the wash meets the plate: the covered
            fraction over 1 + (z/R)^2.
    """

    radius_m: Quantity = 0.0
    position_x_m: Quantity = 0.0
    position_y_m: Quantity = 0.0
    active: Quantity = 0.0
    speed_rad_s: Quantity = 0.0
    voltage_V: Quantity = 0.0
    elapsed_s: Quantity = 0.0
    time_s: Quantity = 0.0
    pitch_rad: Quantity = 0.0
    cos_pitch: Quantity = 1.0
    weight_N: Quantity = 0.0
    load_direction: Quantity = 0.0
    plate_x_m: Quantity = 0.0
    airspeed_m_s: Quantity = 0.0
    acceleration_rad_s2: Quantity = 0.0
    height_m: Quantity = 0.0
    coverage: Quantity = 0.0
    neighbour_images: Quantity = 0.0
    body_images: Quantity = 0.0
    body_weight: Quantity = 0.0
    plane: Quantity = LEVEL
    axial_share: Quantity = 1.0
    rate_rad_s: Quantity = 0.0
    thrust_N: Quantity = ()
    moved_s: Quantity = 0.0
    moved_direction: Quantity = 0.0
    past_load: Quantity = (0.0, 0.0, 0.0, 0.0)
    past_wash: Quantity = (0.0, 0.0, 0.0, 0.0)


N_STAYING, N_BEFORE_RATE = map(Flow._fields.index, ("height_m", "rate_rad_s"))
"""How many fields of a Flow stay, and how many stand before what changes within a step."""

N_WITH_THRUST = N_BEFORE_RATE + 2  # fields up to the thrusts; a constant slice for compiled code
PAST_S = (10.0, 30.0, 100.0, 300.0)  # time constants of `Flow.past_load` and `past_wash`
NO_FLOW = Flow()  # for hooks that depend on the effect's numbers alone, such as a lag

Hook = Callable[..., Any]
"""hook(p, i, flow), p the effect's named numbers and i the disc (0 for hooks of the whole body); a
hook that changes a quantity takes it last: hook(p, i, flow, quantity)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Hooks:
    """Hold an effect's part of the physics.

    Attributes:
        tilt: lean of the plate about the y axis, added: rad, positive brings +x rotors nearer.
        height: a disc's distance to the surface, changed: m; the body's centre follows by the mean
            change of the discs.
        coverage: a disc's covered fraction, changed.
        speed: a disc's commanded rotor speed, changed: rad/s.
        followed_speed: a disc's speed half a plant step after `flow.speed_rad_s`, as the lag alone
            has it, changed: rad/s.
        denominator: term of a disc's thrust denominator, added.
        image_share: factor of the sum of these terms.
        response: a disc's thrust ratio at its own speed for that of the sum (at equal induced
            power), changed.
        drag: a disc's drag torque over that far from any surface, at equal speed, for the sum's
            thrust ratio; 1 without, one effect at most.
        factor: factor of a disc's thrust.
        torque: torque about the pitch axis, added: N m, positive nose down as in eq. (9).
        dry_friction: torque that the hinge can hold at rest or opposes to motion, added: N m, not
            negative; the plant decides between stick and slip.
        dry_width: rate over which dry friction builds up to its full torque, added: rad/s, not
            negative; 0 where it holds at rest.
        dry_give: angle by which the hinge yields before it slips, added: rad, not negative; 0
            where it holds at rest.
        random_torque: standard deviation (N m) and correlation time (s) of a random torque about
            the pitch axis, an Ornstein-Uhlenbeck process.
        lag_s: time constant with which rotor speed follows its command, added: s.
        delay_s: time between a command and its arrival at the motors, added: s.
        thrust_reading: the load cell's reading, changed: N.
        gyro_reading: the gyro's reading, changed: rad/s.
        play_N: half width of a play that a simulated load cell's reading stays behind; such an
            effect's `thrust_reading` is then left to the simulation.
    """

    tilt: Hook | None = None
    height: Hook | None = None
    coverage: Hook | None = None
    speed: Hook | None = None
    followed_speed: Hook | None = None
    denominator: Hook | None = None
    image_share: Hook | None = None
    response: Hook | None = None
    drag: Hook | None = None
    factor: Hook | None = None
    torque: Hook | None = None
    dry_friction: Hook | None = None
    dry_width: Hook | None = None
    dry_give: Hook | None = None
    random_torque: Hook | None = None
    lag_s: Hook | None = None
    delay_s: Hook | None = None
    thrust_reading: Hook | None = None
    gyro_reading: Hook | None = None
    play_N: Hook | None = None


HOOKS = tuple(item.name for item in fields(Hooks))  # names of all hooks


@dataclass(frozen=True, slots=True)
class Derived:
    """Name a quantity and how it follows from free parameters.

    Attributes:
        function: function(values by full name) -> quantity, elementwise on arrays; parameters
            that were not free are constants of the function.
    """

    name: str
    unit: str
    function: Callable[[Mapping[str, Any]], Any]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Effect:
    """Describe one physical effect and supply its part of the physics.

    Attributes:
        name: as in files and on the command line.
        title: for people, three or four words.
        proper_noun: whether the title begins with a person's name, which keeps its capital.
        description: what it is, one or two sentences.
        subsystem: which link of the chain it sits in.
        order: place among the effects of its subsystem, ties by name.
        parameters: with units, neutral values, default bounds and tolerances; hooks take their
            values as `p`, a named tuple.
        confused_with: names of effects that look alike, with what separates them.
        separated_by: what to measure so that a fit can separate the effect's first parameter from
            another, by the other's full name ("R_m").
        trends_over: columns over which residuals trend where the effect is missing.
        law_error: standard error of what it does over its departure from neutral.
        benches: on which kinds of bench an explanation may name it; none for effects that are
            there for simulation only.
        adjusted_on: on which kinds of bench every explanation adjusts it within its priors and
            never names it: what an owner knows only roughly.
        supply_loss: the parameter that is the supply's linear loss (1/s), which pulses beside
            speeds and voltage show; empty for none.
        headline: number that a reader of a fit looks for first, by its own name; of several, with
            what they all begin with ("factor_"); empty for none.
        derived: quantities that a fit reports, by full names of the effect's free parameters.
        always_compiled: whether it stands in every compiled loop, neutral or not, so that one
            compilation serves nearly all models.
        acts_in_flight: False for what belongs to a hinge, a load cell or a plate's stage.
        rig_values: values of its parameters that follow from a rig.
        tolerance_of: tolerances that go with the vehicle's size, for parameters that state none
            themselves; a model file that states one goes first (`tolerances.tolerances`).
        configure: builds the effect for settings in a model file, for example its knots.
        numbers: makes `p` of the values where it is no named tuple of the parameters' names.
        knots_setting: name of the setting that lists its parameters `knot_...`; empty without.
        distance_law: what a law of thrust against distance states of itself; None for what is no
            such law. A model has one of them.

    Raises:
        InputError: `numbers` has other names than `parameters`, or another order.
    """

    name: str
    title: str
    proper_noun: bool = False
    description: str
    subsystem: Subsystem
    order: int = 50
    law: str
    parameters: tuple[Parameter, ...]
    hooks: Hooks
    shows: str
    source: str
    confused_with: Mapping[str, str]
    separated_by: Mapping[str, str] = field(default_factory=dict)
    trends_over: tuple[str, ...] = ()
    law_error: float = LAW_ERROR
    benches: frozenset[BenchKind] = frozenset(BENCH_KINDS)
    adjusted_on: frozenset[BenchKind] = frozenset()
    supply_loss: str = ""
    headline: str = ""
    derived: Callable[[Sequence[str]], Sequence[Derived]] | None = None
    always_compiled: bool = False
    acts_in_flight: bool = True
    rig_values: Callable[[Rig], Mapping[str, float]] | None = None
    tolerance_of: Callable[[Rig, BenchKind], Mapping[str, float]] | None = None
    configure: Callable[[Mapping[str, Any]], Effect] | None = None
    numbers: Callable[..., Any] | None = None
    knots_setting: str = ""
    distance_law: DistanceLaw | None = None

    def __post_init__(self) -> None:
        names = tuple(item.name for item in self.parameters)
        named = getattr(self.numbers, "_fields", names)
        if named != names:
            raise InputError(
                f"effect {self.name!r}: its numbers are {', '.join(named)}, its parameters "
                f"{', '.join(names)}; give both the same names in the same order"
            )

    @property
    def phrase(self) -> str:
        """The title as it stands within a sentence."""
        return self.title if self.proper_noun else self.title[:1].lower() + self.title[1:]

    @property
    def makes_p(self) -> Callable[..., Any]:
        """What makes the hooks' `p` of the values of the parameters, in their order."""
        return self.numbers or _named(tuple(item.name for item in self.parameters))

    @property
    def candidate(self) -> bool:
        """Whether an explanation may name it on some bench."""
        return bool(self.benches)

    @property
    def changes_geometry(self) -> bool:
        """Whether heights or covered areas, and so the images, depend on its parameters."""
        hooks = self.hooks
        return any(hook is not None for hook in (hooks.tilt, hooks.height, hooks.coverage))


@expression
def all_in_order(*numbers: Quantity) -> tuple[Quantity, ...]:
    """Return the numbers as they are: `numbers` of an effect that has as many as it is given."""
    return numbers


@cache
def _named(names: tuple[str, ...]) -> Callable[..., Any]:
    return namedtuple("Numbers", names)


def number(
    name: str,
    unit: str,
    value: float,
    description: str,
    *,
    neutral: float | None = None,
    within: tuple[float, float] = (-inf, inf),
    tolerance: float | None = None,
    prior: Prior | None = None,
    source: str = "neutral value",
) -> Parameter:
    """Return an effect's parameter."""
    return Parameter(
        name, unit, value, neutral=neutral, lower=within[0], upper=within[1],
        prior=Prior() if prior is None else prior, tolerance=tolerance, description=description,
        source=source,
    )  # fmt: skip
