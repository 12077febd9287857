"""Curves of T_IGE/T_OGE over distance: a model's with its bands, the closed formulae beside it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from benchtool.core.rig import Rig
from benchtool.physics.conditions import Conditions
from benchtool.physics.model import Model
from benchtool.report.sweep.ground_effect import Band, Curve

Array = NDArray[np.float64]


def conditions_over(rig: Rig, speed_rad_s: Array, z_over_R: Array) -> Conditions:
    """Return a level plate under every disc, at these distances (m,) and speeds (n_rotors, 1)."""
    return Conditions.of(
        rig,
        speed_rad_s=speed_rad_s,
        plate_z_m=z_over_R * rig.propulsion.radius_m,
        coverage=np.ones((rig.n_discs, 1)),
    )


def values_at(model: Model, draws: Mapping[str, Array] | None = None) -> list[Any]:
    """Return all values of a model, those that are drawn (d, 1) in place of its own."""
    known = draws or {}
    return [known.get(name, item.value) for name, item in model.parameters.items()]


def factor_over(
    model: Model, speed_rad_s: Array, z_over_R: Array, draws: Mapping[str, Array] | None = None
) -> Any:
    """Return T_IGE/T_OGE (m,), or (d, m) with draws."""
    conditions = conditions_over(model.rig, speed_rad_s, z_over_R)
    return model.factor(conditions, values_at(model, draws))


def band_of(spread: Array, level: Literal[68, 95]) -> Band:
    """Return the central interval of draws (d, m) at a level in per cent."""
    lower, upper = np.percentile(spread, [50.0 - level / 2.0, 50.0 + level / 2.0], axis=0)
    return Band(lower, upper, level)


def bands_over(
    model: Model, speed_rad_s: Array, z_over_R: Array, draws: Mapping[str, Array]
) -> tuple[Band, ...]:
    """Return the 68 and the 95 % band of a model's curve; none without draws."""
    if not draws:
        return ()
    spread = np.asarray(factor_over(model, speed_rad_s, z_over_R, draws), float)
    spread = np.broadcast_to(spread, (len(next(iter(draws.values()))), len(z_over_R)))
    return band_of(spread, 68), band_of(spread, 95)


def formula_curves(rig: Rig, speed_rad_s: Array, z_over_R: Array) -> list[Curve]:
    """Return eq. (2), and eq. (3) where more than one rotor turns."""
    single = Model.single(rig)
    turning = int(np.asarray(speed_rad_s > 0.0).sum())
    alone = factor_over(single, speed_rad_s, z_over_R)
    curves = [Curve(z_over_R, alone, "eq. (2), one rotor", "formula")]
    if turning > 1:
        images = single.with_effect("neighbour_images")
        label = f"eq. (3), {turning} rotors" if turning != 4 else "eq. (3), quadrotor"
        curves.append(Curve(z_over_R, factor_over(images, speed_rad_s, z_over_R), label, "quad"))
    return curves
