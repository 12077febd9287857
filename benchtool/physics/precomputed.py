"""A model made ready for many evaluations on the same conditions.

What no free parameter can change (heights, covered areas, images) is worked out once, and discs
that are alike are merged into one, so that an evaluation costs what a hand-written formula would.
Where only the height of a level plate moves, images at equal distance are summed before.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from benchtool.core.array_type import Array
from benchtool.physics.conditions import Conditions
from benchtool.physics.disc_thrust import bound_hooks
from benchtool.physics.effects.effect import Flow
from benchtool.physics.fold import chained
from benchtool.physics.images import image_velocity
from benchtool.physics.model import Model

Images = list[tuple[float, Any]]  # (distance, summed source) of images that blow together


class Prepared:
    """Evaluate a model on fixed conditions for many values of its free parameters.

    Args:
        merge: let equal discs be one; not where the speed of each is needed.
    """

    def __init__(self, model: Model, conditions: Conditions, *, merge: bool = True) -> None:
        self.model = model
        self.conditions = conditions
        self._names = tuple(model.parameters)
        self._radius = self._names.index("R_m")
        self._flow: Flow | None = None
        self._images: list[Images] = []
        effects = model.present_effects
        moving = {
            name: effect
            for effect in effects
            if effect.changes_geometry or effect.hooks.speed is not None
            for item in effect.parameters
            if (name := f"{effect.name}.{item.name}") in model.parameters.free_names
        }
        if model.motor_slope_Nm_s is not None and not conditions.speed_measured:
            return  # speeds go with the factors
        whole = model.flow(conditions, model.parameters.values_array())
        flow = merged(whole, len(conditions)) if merge and mergeable(model) else whole
        tilted = np.any(conditions.plate_tilt_rad) or any(e.hooks.tilt for e in effects)
        turning = [i for i, speed in enumerate(whole.speed_rad_s) if np.any(speed)]
        is_one_height = len(flow.height_m) == 1 and not tilted
        if not moving:
            self._flow = flow
        elif turning and is_one_height and all(e.hooks.height for e in moving.values()):
            self._flow, self._height = flow, chained(bound_hooks(effects, "height"))
            sources = zip(whole.coverage, whole.active, strict=True)
            blown = [area * active for area, active in sources]
            distances = model.rig.disc_distances_m[turning[0]]
            self._images = [
                _together((distances[j], blown[j]) for j in turning[1:]),
                _together((arm_m, 1.0) for arm_m in model.body_images.arm_m),
            ]
            moved = model.parameters.values_array()
            for name in moving:
                item = model.parameters[name]
                end = item.upper if np.isfinite(item.upper) else item.value + abs(item.value)
                moved[self._names.index(name)] += 0.1 * (end - item.value)
            exact = model.thrust_N(conditions, moved)
            if not np.allclose(self.thrust_N(moved), exact, rtol=1e-9, atol=0.0):
                self._flow = None  # the heights of the discs part, or the speeds move with them

    def flow(self, values: Any) -> Flow:
        """Return what the hooks see; `values` as `Model.thrust_N`."""
        if self._flow is None:
            return self.model.flow(self.conditions, values)
        flow = self._flow._replace(radius_m=values[self._radius])
        if not self._images:
            return flow
        free = flow._replace(height_m=[self.conditions.plate_z_m])
        z = self._height(0, free.height_m[0], free, self.model.numbers(values))
        near, body = (
            sum(source * image_velocity(z, z, distance) for distance, source in images)
            for images in self._images
        )
        plane = flow.plane._replace(centre_m=z)
        return flow._replace(height_m=[z], neighbour_images=[near], body_images=[body], plane=plane)

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


def _together(images: Iterable[tuple[float, Any]]) -> Images:
    """Return images (distance, source) with the sources of equal distance summed."""
    summed: dict[float, Any] = {}
    for distance, source in images:
        near = next((d for d in summed if abs(d - distance) <= 1e-11 * d), distance)
        summed[near] = summed.get(near, 0.0) + source
    return list(summed.items())
