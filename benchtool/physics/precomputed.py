"""Model with precomputed geometry, for many evaluations under the same conditions.

Quantities independent of the free parameters (heights, coverages, images) are computed once and
equal discs are merged, so that an evaluation is as fast as a hand-written formula. If only the
height of a level plate depends on free parameters, images at equal distance are summed beforehand.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from benchtool.core.units import Array
from benchtool.physics.conditions import Conditions
from benchtool.physics.disc_thrust import bound_hooks
from benchtool.physics.effects.effect import N_CONSTANT, Flow
from benchtool.physics.fold import chain_hooks
from benchtool.physics.images import image_velocity
from benchtool.physics.model import Model

# Fields of a flow with one value for each disc, except the speed: the last are heights, coverages
# and images
IMAGES_END = Flow._fields.index("body_weight")
DISC_FIELDS = ("position_x_m", "position_y_m", "active", *Flow._fields[N_CONSTANT:IMAGES_END])

Images = list[tuple[float, Any]]  # (distance, sum of the source strengths at that distance)


class PrecomputedModel:
    """Model under fixed conditions, as a function of its free parameters.

    Equal discs are merged unless the speed of each is needed.
    """

    def __init__(self, model: Model, conditions: Conditions, *, merge: bool = True) -> None:
        self.model = model
        self.conditions = conditions
        self._names = tuple(model.parameters)
        self._radius = self._names.index("R_m")
        self._flow: Flow | None = None
        self._images: list[Images] = []
        effects = model.present_effects
        geometry_effects = {
            name: effect
            for effect in effects
            if effect.changes_geometry or effect.hooks.speed is not None
            for item in effect.parameters
            if (name := f"{effect.name}.{item.name}") in model.parameters.free_names
        }
        if model.motor_slope_Nm_s is not None and not conditions.speed_measured:
            return  # speeds depend on the thrust factors
        full_flow = model.flow(conditions, model.parameters.values_array())
        flow = full_flow
        # Without effects on the thrust of individual discs.
        if merge and all(effect.hooks.factor is None for effect in effects):
            flow = merge_discs(full_flow, len(conditions))
        flow = flow._replace(
            coverage=[_uniform_number(coverage) for coverage in flow.coverage],
            body_weight=_uniform_number(flow.body_weight),
            axial_share=_uniform_number(flow.axial_share),
        )
        is_tilted = np.any(conditions.plate_tilt_rad) or any(e.hooks.tilt for e in effects)
        running = [i for i, speed in enumerate(full_flow.speed_rad_s) if np.any(speed)]
        is_one_height = len(flow.height_m) == 1 and not is_tilted
        if not geometry_effects:
            self._flow = flow
        elif running and is_one_height and all(e.hooks.height for e in geometry_effects.values()):
            self._flow, self._height = flow, chain_hooks(bound_hooks(effects, "height"))
            coverages = zip(full_flow.coverage, full_flow.active, strict=True)
            sources = [_uniform_number(coverage * active) for coverage, active in coverages]
            distances = model.rig.disc_distances_m[running[0]]
            self._images = [
                _sum_by_distance((distances[j], sources[j]) for j in running[1:]),
                _sum_by_distance((arm_m, 1.0) for arm_m in model.body_images.arm_m),
            ]
            test_values = model.parameters.values_array()
            for name in geometry_effects:
                item = model.parameters[name]
                end = item.upper if np.isfinite(item.upper) else item.value + abs(item.value)
                test_values[self._names.index(name)] += 0.1 * (end - item.value)
            exact = model.thrust_N(conditions, test_values)
            if not np.allclose(self.thrust_N(test_values), exact, rtol=1e-9, atol=0.0):
                self._flow = None  # disc heights differ, or speeds depend on the parameters

    def flow(self, values: Any) -> Flow:
        """Return the input of the hooks; `values` as in `Model.flow`."""
        if self._flow is None:
            return self.model.flow(self.conditions, values)
        flow = self._flow._replace(radius_m=values[self._radius])
        if not self._images:
            return flow
        uncorrected = flow._replace(height_m=[self.conditions.plate_z_m])
        z = self._height(0, uncorrected.height_m[0], uncorrected, self.model.numbers(values))
        near, body = (
            sum(source * image_velocity(z, z, distance) for distance, source in images)
            for images in self._images
        )
        plane = flow.plane._replace(centre_m=z)
        return flow._replace(height_m=[z], neighbour_images=[near], body_images=[body], plane=plane)

    def thrust_N(self, values: Any) -> Any:
        """Return the load cell's settled reading (..., m): N; `values` as in `Model.flow`."""
        return self.model.reading_N(self.flow(values), values)


def merge_discs(flow: Flow, m: int) -> Flow:
    """Return the flow with equal discs merged and stopped discs removed.

    Thrust is the sum of k w^2 F over discs, so discs of equal F merge into one with the sum of
    their squared speeds.
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

    merged = {name: [getattr(flow, name)[first] for first, _ in groups] for name in DISC_FIELDS}
    return flow._replace(**merged, speed_rad_s=[np.sqrt(squares) for _, squares in groups])


def _uniform_number(quantity: Any) -> Any:
    """Return an array of equal values as one number: a product with it is a number per walker."""
    return quantity if np.ptp(quantity) != 0.0 else float(np.ravel(quantity)[0])


def _sum_by_distance(images: Iterable[tuple[float, Any]]) -> Images:
    """Return images (distance, source) with the sources at equal distance summed."""
    summed: dict[float, Any] = {}
    for distance, source in images:
        near = next((d for d in summed if abs(d - distance) <= 1e-11 * d), distance)
        summed[near] = summed.get(near, 0.0) + source
    return list(summed.items())
