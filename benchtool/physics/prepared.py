"""A model made ready for many evaluations on the same conditions.

What no free parameter can change (heights, covered areas, images) is worked out once, and discs
that cannot be told apart are merged into one, so that an evaluation costs what a hand-written
formula would.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.physics.conditions import Conditions
from benchtool.physics.effects.effect import Flow
from benchtool.physics.model import Model
from benchtool.physics.moving_heights import MovingHeights, moving_heights

Array = NDArray[np.float64]


class Prepared:
    """Evaluate a model on fixed conditions for many values of its free parameters."""

    def __init__(self, model: Model, conditions: Conditions) -> None:
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
        if moving:
            self._moving = moving_heights(model, conditions)
        else:
            flow = model.flow(conditions, model.parameters.values_array())
            self._flow = merged(flow, len(conditions)) if mergeable(model) else flow

    def thrust_N(self, values: Any) -> Any:
        """Return the load cell's settled reading (..., m): N; `values` as `Model.thrust_N`."""
        if self._moving is not None:
            return self.model.reading_N(self._moving.flow(values), values)
        if self._flow is None:
            return self.model.thrust_N(self.conditions, values)
        return self.model.reading_N(self._flow._replace(radius_m=values[self._radius]), values)


def mergeable(model: Model) -> bool:
    """Whether no present effect tells one disc from another by its own speed."""
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
