"""A model made ready for many evaluations on the same conditions.

What no free parameter can change (heights, covered areas, images) is worked out once, and discs
that are alike are merged into one, so that an evaluation costs what a hand-written formula would.
Where only heights move (plate offset, plate tilt), sources and distances stay, and images of one
height at equal distance are summed before their formula is evaluated: a level quadrotor takes three
images, not sixteen.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from benchtool.core.array import Array
from benchtool.physics.conditions import Conditions
from benchtool.physics.disc_thrust import owned
from benchtool.physics.effects.effect import Flow, Quantity
from benchtool.physics.fold import chained
from benchtool.physics.model import Model
from benchtool.physics.tilt import Plane, TiltRule, axis_cosine, height_over, tilt_rule

Images = list[tuple[int, float, Quantity]]
"""(which height, distance, summed source) of images that blow together."""

PROBES = (0.0, 0.37, -0.23)
"""How far free parameters are moved, in parts of their bounds, to see which discs stay alike."""

ALIKE = 1e-11


class Prepared:
    """Evaluate a model on fixed conditions for many values of its free parameters.

    Args:
        model: with its free parameters.
        conditions: of m samples.
        merge: let equal discs be one; not where the speed of each is needed.
    """

    def __init__(self, model: Model, conditions: Conditions, *, merge: bool = True) -> None:
        self.model = model
        self.conditions = conditions
        self._names = tuple(model.parameters)
        self._radius = self._names.index("R_m")
        free = set(model.parameters.free_names)
        moving = [
            effect
            for effect in model.present_effects
            if any(f"{effect.name}.{item.name}" in free for item in effect.parameters)
            and (effect.changes_geometry or effect.hooks.speed is not None)
        ]
        self._flow: Flow | None = None
        self._moving: MovingHeights | None = None
        if model.motor_slope_Nm_s is not None and not conditions.speed_measured:
            return  # speeds go with the factors
        if moving:
            self._moving = moving_heights(model, conditions) if merge else None
        else:
            flow = model.flow(conditions, model.parameters.values_array())
            self._flow = merged(flow, len(conditions)) if merge and mergeable(model) else flow

    def flow(self, values: Any) -> Flow:
        """Return what the hooks see; `values` as `Model.thrust_N`."""
        if self._moving is not None:
            return self._moving.flow(values)
        if self._flow is None:
            return self.model.flow(self.conditions, values)
        return self._flow._replace(radius_m=values[self._radius])

    def thrust_N(self, values: Any) -> Any:
        """Return the load cell's settled reading (..., m): N; `values` as `Model.thrust_N`."""
        return self.model.reading_N(self.flow(values), values)


def mergeable(model: Model) -> bool:
    """Whether no present effect treats discs differently by their own speed."""
    return all(effect.hooks.factor is None for effect in model.present_effects)


def merged(flow: Flow, m: int) -> Flow:
    """Return the flow with equal discs merged into one and still discs left out.

    Thrust sums k w^2 F over discs, so discs of equal F merge into one whose squared speed is the
    sum of theirs.
    """

    def row(quantity: Any) -> Array:
        return np.broadcast_to(np.asarray(quantity, float), (m,))

    groups: list[tuple[int, Array]] = []
    for i in range(len(flow.height_m)):
        speed = row(flow.speed_rad_s[i])
        if not speed.any():
            continue
        for position, (first, squares) in enumerate(groups):
            if all(
                np.allclose(row(field[i]), row(field[first]), rtol=1e-12, atol=1e-15)
                for field in (flow.height_m, flow.coverage, flow.neighbour_images, flow.body_images)
            ):
                groups[position] = (first, squares + speed * speed)
                break
        else:
            groups.append((i, speed * speed))
    kept = [first for first, _ in groups]

    def only(quantity: Any) -> list[Any]:
        return [quantity[i] for i in kept]

    return flow._replace(
        position_x_m=only(flow.position_x_m),
        position_y_m=only(flow.position_y_m),
        height_m=only(flow.height_m),
        coverage=only(flow.coverage),
        active=only(flow.active),
        speed_rad_s=[np.sqrt(squares) for _, squares in groups],
        neighbour_images=only(flow.neighbour_images),
        body_images=only(flow.body_images),
    )


class MovingHeights:
    """Work out the flow of a model on fixed conditions for moving heights."""

    def __init__(self, model: Model, conditions: Conditions) -> None:
        tilts = any(effect.hooks.tilt is not None for effect in model.present_effects)
        self._height = chained(owned(model.present_effects, "height"))
        self._rule = tilt_rule(model.tilt_rule)
        self._model, self._conditions = model, conditions
        self._radius = tuple(model.parameters).index("R_m")
        probes = [model.flow(conditions, values) for values in _probed(model)]
        base, m = probes[0], len(conditions)
        read = model.plate_plane(conditions, model.numbers(model.parameters.values_array()))
        self._plane = None if tilts else Plane(*(_plain(part, m) for part in read))
        groups = _alike(probes, m)
        kept = [group[0] for group in groups]
        squares = [sum(_row(base.speed_rad_s[i], m) ** 2 for i in group) for group in groups]
        self._flow = base._replace(
            position_x_m=[base.position_x_m[i] for i in kept],
            position_y_m=[base.position_y_m[i] for i in kept],
            coverage=[_plain(base.coverage[i], m) for i in kept],
            active=[base.active[i] for i in kept],
            speed_rad_s=[np.sqrt(square) for square in squares],
            body_weight=_plain(base.body_weight, m),
        )
        sources = [
            _row(area, m) * _row(active, m)
            for area, active in zip(base.coverage, base.active, strict=True)
        ]
        group_of = {i: number for number, group in enumerate(groups) for i in group}
        distances = model.rig.disc_distances_m
        self._neighbours = [
            _together((group_of[j], distances[i, j], sources[j]) for j in group_of if j != i)
            for i in kept
        ]
        x_m, y_m, arm_m = model.body_images
        apart = float(tilts or np.any(conditions.plate_tilt_rad))
        places = [*zip(apart * x_m, apart * y_m, strict=True)]
        self._body_places = list(dict.fromkeys(places))
        numbers = map(self._body_places.index, places)
        self._body = _together((at, c, np.ones(m)) for at, c in zip(numbers, arm_m, strict=True))

    def flow(self, values: Any) -> Flow:
        """Return the flow of the kept discs; `values` as `Model.thrust_N`."""
        p, rule, flow = self._model.numbers(values), self._rule, self._flow
        plane = self._plane or self._model.plate_plane(self._conditions, p)
        places = zip(flow.position_x_m, flow.position_y_m, strict=True)
        free = [height_over(plane, *place) for place in places]
        flow = flow._replace(radius_m=values[self._radius], height_m=free, plane=plane)
        heights = [self._height(i, free[i], flow, p) for i in range(len(free))]
        changes = [height - before for height, before in zip(heights, free, strict=True)]
        plane = plane._replace(centre_m=plane.centre_m + sum(changes) / max(len(changes), 1))
        share = rule.share(axis_cosine(plane))
        under = [height_over(plane, *place) for place in self._body_places]

        def body(at: Quantity) -> Quantity:
            return share * _blown(rule, at, under, self._body)

        once = body(plane.centre_m) if rule.one_body else None
        return flow._replace(
            height_m=heights,
            neighbour_images=[
                share * _blown(rule, at, heights, images)
                for at, images in zip(heights, self._neighbours, strict=True)
            ],
            body_images=[body(at) if once is None else once for at in heights],
            plane=plane,
            axial_share=share,
        )


def moving_heights(model: Model, conditions: Conditions) -> MovingHeights | None:
    """Return the quick way, or None where it does not give what the model itself gives."""
    free = model.parameters.free_names
    for effect in model.present_effects:
        moves = any(name.startswith(f"{effect.name}.") for name in free)
        drives = effect.hooks.speed is not None
        if effect.hooks.factor is not None or (moves and effect.hooks.coverage is not None):
            return None
        if moves and drives and not conditions.speed_measured:
            return None
    quick = MovingHeights(model, conditions)
    for values in _probed(model):
        exact = model.thrust_N(conditions, values)
        if not np.allclose(model.reading_N(quick.flow(values), values), exact, rtol=1e-9, atol=0.0):
            return None
    return quick


def _probed(model: Model) -> list[Array]:
    """Return parameter values (n_parameters,) at and around the present ones."""
    out = []
    for part in PROBES:
        values = model.parameters.values_array()
        for position, (name, item) in enumerate(model.parameters.items()):
            if item.free and name not in {"k", "R_m"} and not name.startswith("noise."):
                end = item.upper if part > 0.0 else item.lower
                reach = abs(end - item.value) if np.isfinite(end) else 0.1 * abs(item.value)
                values[position] += part * reach
        out.append(values)
    return out


def _alike(flows: Sequence[Flow], m: int) -> list[list[int]]:
    """Return groups of turning discs whose heights, areas and images agree in every flow."""
    groups: list[list[int]] = []
    for i in range(len(flows[0].height_m)):
        if not _row(flows[0].speed_rad_s[i], m).any():
            continue
        for group in groups:
            if all(
                np.allclose(_row(field[i], m), _row(field[group[0]], m), rtol=ALIKE, atol=1e-15)
                for flow in flows
                for field in (flow.height_m, flow.coverage, flow.neighbour_images, flow.body_images)
            ):
                group.append(i)
                break
        else:
            groups.append([i])
    return groups


def _together(images: Iterable[tuple[int, float, Array]]) -> Images:
    """Return images with those of one height at equal distance summed, silent ones left out.

    Args:
        images: which height, distance and source (m,) of each.
    """
    summed: dict[tuple[int, float], Array] = {}
    for height, distance, source in images:
        alike = (
            key for key in summed if key[0] == height and abs(key[1] - distance) <= ALIKE * distance
        )
        near = next(alike, (height, float(distance)))
        summed[near] = summed.get(near, np.zeros(len(source))) + source
    return [(*near, _plain(source, len(source))) for near, source in summed.items() if source.any()]


def _blown(
    rule: TiltRule, at_m: Quantity, heights_m: Sequence[Quantity], images: Images
) -> Quantity:
    total: Quantity = 0.0
    for height, distance, source in images:
        total = total + source * rule.image(at_m, heights_m[height], distance)
    return total


def _row(quantity: Any, m: int) -> Array:
    return np.broadcast_to(np.asarray(quantity, float), (m,))


def _plain(quantity: Any, m: int) -> Any:
    """Return a number where all entries are equal, else the row (m,)."""
    row = _row(quantity, m)
    return float(row[0]) if m and np.ptp(row) == 0.0 else row
