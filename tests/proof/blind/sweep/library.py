"""The effects that can be hidden one by one or in pairs: parameters, neutral values, tolerances."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from tests.proof.blind.families import Strength, drawn_size
from tests.proof.blind.sweep.bench import Bench
from tests.proof.blind.sweep.layouts import Layout, LayoutName

BEAM_KG, BEAM_RADIUS_M = 1.2, 0.127
"""Vehicle for which the tolerances of forces and of the plate's distance were stated."""

KNOTS = (0.25, 0.5, 0.75)  # covered fractions at which the area factors of a model stand


@dataclass(frozen=True, slots=True, kw_only=True)
class Hidden:
    """Hold one hidden effect: its parameters' true values, and its size in tolerances."""

    name: str
    parameters: Mapping[str, float]
    size: float


@dataclass(frozen=True, slots=True)
class Named:
    """Describe one effect that has a name.

    Attributes:
        unit_of: tolerance of one step of `size` on a layout, in the parameter's unit.
        most_below, most_above: greatest size on either side, in tolerances; 0: physics allows none.
    """

    name: str  # of the effect
    parameter: str  # of the effect; where there are several, `shares` gives them
    field: str  # of the bench that holds it
    unit_of: Callable[[Layout], float]
    neutral: float = 0.0  # value at which the effect is absent
    most_below: float = 8.0
    most_above: float = 8.0
    layouts: tuple[LayoutName, ...] = ("single", "quad")  # on which it can be told at all

    def hide(self, rng: np.random.Generator, layout: Layout, strength: Strength) -> Hidden:
        """Draw a size and a side."""
        size = drawn_size(rng, strength, self.most_below, self.most_above)
        value = self.neutral + size * self.unit_of(layout)
        parameters = {self.parameter: value} if self.parameter else shares(power_of(value))
        return Hidden(name=self.name, parameters=parameters, size=size)

    def value_in(self, bench: Bench) -> float:
        """Return what the bench has of it, in tolerances past neutral."""
        value = float(getattr(bench, self.field))
        if not self.parameter:
            value = departure(value)
        return (value - self.neutral) / self.unit_of(bench.layout)

    def put_into(self, bench: Bench, size: float) -> Bench:
        """Return the bench with so many tolerances of this effect, whatever it had before."""
        value = self.neutral + size * self.unit_of(bench.layout)
        return replace(bench, **{self.field: power_of(value) if not self.parameter else value})

    def tolerances(self, layout: Layout) -> dict[str, float]:
        """Return the tolerance of every parameter."""
        names = [self.parameter] if self.parameter else [f"share_{k + 1}" for k in range(3)]
        return dict.fromkeys(names, self.unit_of(layout))


def shares(power: float) -> dict[str, float]:
    """Return what a^power takes of what is left up to each knot, as area factors are stated."""
    factors = [0.0, *(knot**power for knot in KNOTS)]
    return {
        f"share_{k}": (b - a) / (1.0 - a) for k, (a, b) in enumerate(pairwise(factors), start=1)
    }


def departure(power: float) -> float:
    """Return the greatest change of a share, with its sign; 0 for the straight line."""
    off = [value - shares(1.0)[name] for name, value in shares(power).items()]
    return max(off, key=abs)


def power_of(value: float) -> float:
    """Return the power whose greatest change of a share is this."""
    low, high = 0.2, 5.0
    for _ in range(60):
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if departure(middle) < value else (middle, high)
    return float(np.sqrt(low * high))


def _plain(number: float) -> Callable[[Layout], float]:
    return lambda layout: number


def _of_weight(number: float) -> Callable[[Layout], float]:
    return lambda layout: number * layout.mass_kg / BEAM_KG


def _of_radius(number: float) -> Callable[[Layout], float]:
    return lambda layout: number * layout.radius_m / BEAM_RADIUS_M


_ALL = (
    Named(
        "neighbour_images", "strength", "neighbours", _plain(0.2), most_below=0.0, layouts=("quad",)
    ),
    Named("body_lift", "K_b", "K_b", _plain(0.25), most_below=0.0, layouts=("quad",)),
    # The plate is never read so far off that a disc would hit it.
    Named("plate_offset", "dz_m", "plate_dz_m", _of_radius(0.003), most_below=4.0),
    Named("plate_tilt", "angle_rad", "plate_tilt_rad", _plain(0.01)),
    # Parameters: the three area factors' shares; a power of the covered fraction makes them. The
    # straight line leaves only so much room below.
    Named("partial_coverage", "", "coverage_power", _plain(0.05), most_below=4.0),
    Named("thrust_exponent", "excess", "exponent_excess", _plain(0.02)),
    Named("battery_sag", "rate_per_s", "sag_per_s", _plain(2.5e-5), most_below=0.0),
    Named("load_cell_drift", "rate_N_per_s", "drift_N_per_s", _of_weight(1e-4)),
    Named("tare_offset", "thrust_N", "tare_N", _of_weight(0.02)),
    Named("load_cell_hysteresis", "half_width_N", "hysteresis_N", _of_weight(0.02), most_below=0.0),
    Named("wall_blockage", "share", "blockage", _plain(0.01), most_below=0.0),
)

NAMED: dict[str, Named] = {effect.name: effect for effect in _ALL}
