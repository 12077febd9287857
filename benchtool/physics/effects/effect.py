"""Effect interface: parameters, hooks, and metadata of one physical effect.

A hook is a module-level function, registered by `Hooks` as an expression: branch-free, so that the
same source runs on scalars in a compiled loop, on arrays in a fit, and on complex steps. None means
that the effect has no such hook. A model never calls hooks of an effect whose parameters are fixed
at neutral values.

Hooks get discs, not rotors: coaxial rotors share a disc. The disc axis comes first, so
`flow.height_m[i]` is a scalar in a simulator and an array over samples in a fit.
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cache
from math import inf
from typing import Any, Literal, NamedTuple, TypeAlias

from benchtool.core.errors import InputError
from benchtool.core.parameter import Parameter
from benchtool.core.rig import Rig
from benchtool.physics.distance_law import DistanceLaw
from benchtool.physics.expression import Quantity as Quantity
from benchtool.physics.expression import expression as expression
from benchtool.physics.images import LEVEL

Subsystem = Literal["pwm_to_rpm", "rpm_to_thrust", "hinge", "sensor", "plate"]
# In the order of the chain from pulse width to reading
SUBSYSTEMS: tuple[Subsystem, ...] = ("pwm_to_rpm", "plate", "rpm_to_thrust", "hinge", "sensor")

BenchKind = Literal["pitch", "sweep"]
BENCH_KINDS: tuple[BenchKind, ...] = ("pitch", "sweep")  # body on a hinge; plate and load cell

# Standard error of an effect's contribution over its departure from neutral: no bench follows a law
# exactly (rotors accelerate 1 to 2 % faster than they decelerate, encoders wobble). Chosen on
# development records of pitch benches: of 138 intervals 84 % contained the truth without it, 96 %
# with it, 97 % with twice the value.
LAW_ERROR = 0.005


class Flow(NamedTuple):
    """State of the bench at one instant or at many, the input of hooks.

    Constant fields come first; from `height_m` on, fields that depend on effects on heights and on
    images; last, fields that change within a time step. `load_direction` and the history
    (`moved_*`, `past_*`) are 0 if unknown.

    Attributes:
        radius_m: effective rotor radius R: m.
        position_x_m, position_y_m: disc centres (n,): m.
        active: 1 for a disc with running rotors, else 0 (n, ...).
        speed_rad_s: rotor speed (n, ...); on a coaxial disc the root of the summed squares.
        pitch_rad: attitude about the y axis (...): rad; zero for a fixed vehicle.
        cos_pitch: component of `weight_N` along the body's vertical axis, relative (...): the
            cosine of the pitch on a hinge, 1 in flight.
        weight_N: weight carried by the hinge (...); in flight the thrust, along the body's vertical
            axis; zero for a fixed vehicle.
        load_direction: +1 for a load approached from below, -1 from above (...).
        airspeed_m_s: horizontal speed of the rotors relative to the air (...): m/s.
        acceleration_rad_s2: pitch acceleration, for gyro readings (...).
        height_m: distance of each disc to the surface (n, ...): m.
        coverage: fraction of each disc over the surface (n, ...).
        neighbour_images: upward velocity at each disc from the neighbours' images, per R^2 and
            induced velocity (n, ...): 1/m2 (eq. 3).
        body_images: upward velocity at the body's centre from all images (n, ...): 1/m2 (eq. 4);
            equal for all discs, unless the tilt rule uses each rotor's height.
        body_weight: weight w of the body lift from the wake rule (...).
        plane: the surface under the rotor plane (...).
        axial_share: factor on the velocity from a rotor's own image (...): the cosine of the angle
            between the rotor axis and the surface normal, or 1 (`images`). The term of a law of
            thrust against distance is multiplied by it in the sum.
        rate_rad_s: rate about the y axis (...): rad/s; zero for a fixed vehicle.
        thrust_N: thrust of each disc (n, ...), for torque hooks; else empty.
        moved_s: time since the last plate movement (...).
        moved_direction: +1 for a plate distance approached from nearer, -1 from farther (...).
        past_load: summed squared speed over the maximum of the run, low-pass filtered with each
            time constant of `HISTORY_TIME_CONSTANTS_S` (4, ...).
        past_wash: the same for the load times the share of the wake that meets the plate: the
            coverage over 1 + (z/R)^2.
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


# Number of constant fields of a Flow, and of fields before those that change within a time step
N_CONSTANT, N_BEFORE_RATE = map(Flow._fields.index, ("height_m", "rate_rad_s"))
N_WITH_THRUST = N_BEFORE_RATE + 2  # fields up to the thrusts; a constant slice for compiled code
HISTORY_TIME_CONSTANTS_S = (10.0, 30.0, 100.0, 300.0)  # of `Flow.past_load` and `past_wash`
NO_FLOW = Flow()  # for hooks that depend on the effect's numbers alone, such as a lag

# hook(p, i, flow): p the effect's parameters as a named tuple, i the disc (0 for hooks of the whole
# body). A hook that changes a quantity takes it last: hook(p, i, flow, quantity).
Hook = Callable[..., Any]
Numbers: TypeAlias = Any  # the parameters `p`


@dataclass(frozen=True, slots=True, kw_only=True)
class Hooks:
    """Hooks of an effect; None where it has no influence.

    Attributes:
        tilt: tilt of the plate about the y axis to add: rad, positive brings +x rotors nearer.
        height: changed distance of a disc to the surface: m; the body's centre follows by the mean
            change of the discs.
        coverage: changed coverage of a disc.
        speed: changed speed command of a disc: rad/s.
        followed_speed: changed speed of a disc half a plant step after `flow.speed_rad_s`, from
            the speed with the lag alone: rad/s.
        denominator: term to add to the thrust denominator of a disc.
        image_share: factor on the sum of these terms.
        response: changed thrust ratio of a disc, from equal induced power to equal speed.
        drag: drag torque over that out of ground effect at equal speed, from the thrust ratio of
            the sum; default 1, at most one effect.
        factor: factor on the thrust of a disc.
        torque: torque about the pitch axis to add: N m, positive nose down as in eq. (9).
        dry_friction: friction torque of the hinge to add, static and sliding: N m, not negative;
            the plant decides between stick and slip.
        dry_width: rate at which dry friction reaches its full torque, to add: rad/s, not negative;
            0 for stiction.
        dry_give: presliding displacement of the hinge to add: rad, not negative; 0 for stiction.
        random_torque: standard deviation (N m) and correlation time (s) of a random torque about
            the pitch axis, an Ornstein-Uhlenbeck process.
        lag_s: time constant of rotor speed to add: s.
        delay_s: delay between a command and its arrival at the motors, to add: s.
        thrust_reading: changed load cell reading: N.
        gyro_reading: changed gyro reading: rad/s.
        play_N: half width of the backlash model of a simulated load cell; the simulation then does
            not call the effect's `thrust_reading`.
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

    def __post_init__(self) -> None:
        for hook in HOOKS:
            if (function := getattr(self, hook)) is not None:
                expression(function)


HOOKS = tuple(hook.name for hook in fields(Hooks))


@dataclass(frozen=True, slots=True)
class Derived:
    """Quantity derived from free parameters."""

    name: str
    unit: str
    # function(values by full name) -> quantity, elementwise on arrays; fixed parameters are
    # constants of the function
    function: Callable[[Mapping[str, Any]], Any]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Effect:
    """Physical effect with its parameters, hooks and metadata.

    Raises:
        InputError: the field names of `numbers` are not the parameter names in the same order.
    """

    name: str  # identifier in files and on the command line
    title: str = ""  # display name, three or four words; default: the name as words
    # Whether the title begins with a person's name, which stays capitalised
    proper_noun: bool = False
    description: str
    subsystem: Subsystem  # link of the chain from pulse width to reading
    order: int = 50  # position among the effects of its subsystem, ties by name
    law: str
    # With units, neutral values, default bounds and tolerances; hooks get their values as the named
    # tuple `p`
    parameters: tuple[Parameter, ...]
    hooks: Hooks
    shows: str
    source: str
    # Names of similar effects, with the data that separate them
    confused_with: Mapping[str, str] = field(default_factory=dict)
    # Measurements with which a fit can separate the effect's first parameter from another, by the
    # full name of the other ("R_m")
    separated_by: Mapping[str, str] = field(default_factory=dict)
    # Columns over which residuals show a trend without the effect
    trends_over: tuple[str, ...] = ()
    # Standard error of its contribution over its departure from neutral
    law_error: float = LAW_ERROR
    # Kinds of bench on which an explanation may name it; empty for effects for simulation only
    benches: frozenset[BenchKind] = frozenset(BENCH_KINDS)
    # Kinds of bench on which every explanation adjusts it within its priors and never names it
    adjusted_on: frozenset[BenchKind] = frozenset()
    # Parameter that is the linear loss of the supply (1/s), known from pulse widths, speeds and
    # voltage together; empty for none
    supply_loss: str = ""
    # Main parameter for a reader of a fit, by its short name; for several, their common prefix
    # ("factor_"); empty for none
    headline: str = ""
    # Quantities that a fit reports, from full names of the effect's free parameters
    derived: Callable[[Sequence[str]], Sequence[Derived]] | None = None
    # Whether every compiled loop contains it, neutral or not, so that one compilation serves nearly
    # all models
    always_compiled: bool = False
    acts_in_flight: bool = True  # False for effects of a hinge, a load cell or a plate stage
    # Values of its parameters that follow from a rig
    rig_values: Callable[[Rig], Mapping[str, float]] | None = None
    # Tolerances scaled to the vehicle, for parameters without a tolerance; a tolerance in a model
    # file has precedence (`tolerances.model_tolerances`)
    tolerance_of: Callable[[Rig, BenchKind], Mapping[str, float]] | None = None
    # Builds `p` from the values if it is not a named tuple of the parameter names
    numbers: Callable[..., Any] | None = None
    # Name of the setting of a model file with the values of its parameters `knot_...`; empty for
    # none
    knots_setting: str = ""
    with_knots: Callable[[Sequence[float]], Effect] | None = None  # builds it from these values
    # Properties of a law of thrust against distance; None for other effects. A model has one law
    distance_law: DistanceLaw | None = None

    def __post_init__(self) -> None:
        if not self.title:
            object.__setattr__(self, "title", self.name.replace("_", " ").capitalize())
        names = tuple(parameter.name for parameter in self.parameters)
        field_names = getattr(self.numbers, "_fields", names)
        if field_names != names:
            raise InputError(
                f"effect {self.name!r}: the fields of `numbers` are {', '.join(field_names)}, its "
                f"parameters {', '.join(names)}; use the same names in the same order"
            )

    @property
    def phrase(self) -> str:
        """Title for use within a sentence, in lower case."""
        return self.title if self.proper_noun else self.title[:1].lower() + self.title[1:]

    @property
    def build_p(self) -> Callable[..., Any]:
        """Function that builds the hooks' `p` from the parameter values, in their order."""
        return self.numbers or _numbers_class(tuple(item.name for item in self.parameters))

    @property
    def changes_geometry(self) -> bool:
        """True if heights or coverages, and so the images, depend on its parameters."""
        hooks = self.hooks
        return any(hook is not None for hook in (hooks.tilt, hooks.height, hooks.coverage))


@expression
def as_tuple(*numbers: Quantity) -> tuple[Quantity, ...]:
    """Return the numbers as a tuple: `numbers` of an effect with any number of parameters."""
    return numbers


@cache
def _numbers_class(names: tuple[str, ...]) -> Callable[..., Any]:
    return namedtuple("Numbers", names)


def number(
    name: str,
    unit: str,
    value: float,
    description: str,
    within: tuple[float, float] = (-inf, inf),
    **fields: Any,
) -> Parameter:
    """Return a parameter of an effect, with `fields` of `Parameter`."""
    return Parameter(
        name, unit, value, lower=within[0], upper=within[1], description=description,
        **{"source": "neutral value", **fields},
    )  # fmt: skip
