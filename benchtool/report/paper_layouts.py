"""The ratio figures laid out as in the paper, from recipes of one's own runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import InputError
from benchtool.fit.recipe import read_recipe
from benchtool.fit.run_recipe import FitOutput, run_recipe
from benchtool.physics.conditions import Conditions
from benchtool.physics.model import Model
from benchtool.report.fit.figures import fitted_curve, ratio_points
from benchtool.report.page import Figure
from benchtool.report.palette import Role
from benchtool.report.paper_figures import (
    body_lift_figure,
    quad_against_single_figure,
    three_rotors_figure,
    two_rigs_figure,
)
from benchtool.report.sweep.ground_effect import Curve, RatioPoints

Array = NDArray[np.float64]

PAPER_K_B = 2.0
"""Body lift coefficient of the paper's figure 6 ("with K_b = 2")."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Series:
    """Name the recipe folders that the layouts draw; what is not given leaves its figures out.

    Attributes:
        single: one rotor (figures 3, 4 and 6).
        second: one rotor of another rig (figure 3).
        three: three rotors (figure 8).
        quad: the whole quadrotor (figures 4 and 6).
    """

    single: Path | None = None
    second: Path | None = None
    three: Path | None = None
    quad: Path | None = None


def paper_layouts(series: Series) -> dict[str, Figure]:
    """Return the figures that the series allow, by file name.

    Raises:
        InputError: too little is given for any of them.
    """
    fits = {
        name: _fitted(path)
        for name, path in (
            ("single", series.single),
            ("second", series.second),
            ("three", series.three),
            ("quad", series.quad),
        )
        if path is not None
    }
    figures: dict[str, Figure] = {}
    if {"single", "second"} <= set(fits):
        figures["fig03-two-rigs"] = _two_rigs(fits)
    if {"single", "quad"} <= set(fits):
        figures["fig04-quad-and-single"] = _quad(fits)
        figures["fig06-body-lift"] = _body_lift(fits)
    if "three" in fits:
        figures["fig08-three-rotors"] = _three(fits["three"])
    if not figures:
        raise InputError(
            "nothing to draw: give --three for figure 8, --single with --second for figure 3, or "
            "--single with --quad for figures 4 and 6"
        )
    return figures


def _fitted(folder: Path) -> FitOutput:
    recipe = read_recipe(folder)
    return run_recipe(replace(recipe, methods=("least_squares",), compare=()))


def _two_rigs(fits: Mapping[str, FitOutput]) -> Figure:
    first, second = fits["single"], fits["second"]
    z = _distances(first, second)
    return two_rigs_figure(
        _points(first, first.fitted.rig.name),
        _points(second, second.fitted.rig.name),
        _formula(Model.single(first.fitted.rig), z, "PFI, one rotor: eq. (2)"),
        simulated=_simulated(fits),
        basis="equal_rpm2",
    )


def _quad(fits: Mapping[str, FitOutput]) -> Figure:
    single, quad = fits["single"], fits["quad"]
    z = _distances(single, quad)
    rig = quad.fitted.rig
    return quad_against_single_figure(
        _points(single, "one rotor"),
        _points(quad, "quadrotor"),
        _formula(Model.single(single.fitted.rig), z, "PFI, one rotor: eq. (2)"),
        _formula(Model.single(rig).with_effect("neighbour_images"), z, "PFI, quadrotor: eq. (3)"),
        simulated=_simulated(fits),
        basis="equal_rpm2",
    )


def _body_lift(fits: Mapping[str, FitOutput]) -> Figure:
    single, quad = fits["single"], fits["quad"]
    z = _distances(single, quad)
    lifted = Model.single(quad.fitted.rig).with_effect("neighbour_images")
    lifted = lifted.with_effect("body_lift", K_b=PAPER_K_B)
    fit = replace(fitted_curve(quad, z, "eq. (4), fitted", "quad"), style="fit")
    return body_lift_figure(
        _points(single, "one rotor"),
        _points(quad, "quadrotor"),
        _formula(Model.single(single.fitted.rig), z, "PFI, one rotor: eq. (2)"),
        _formula(lifted, z, f"body lift with K_b = {PAPER_K_B:g}: eq. (4)"),
        fit,
        simulated=_simulated(fits),
        basis="equal_rpm2",
    )


def _three(fit: FitOutput) -> Figure:
    z = _distances(fit)
    rig = fit.fitted.rig
    turning = np.array([1.0, 1.0, 1.0, 0.0])[: rig.n_rotors]
    images = Model.single(rig).with_effect("neighbour_images")
    return three_rotors_figure(
        _points(fit, "three rotors"),
        _formula(Model.single(rig), z, "PFI, one rotor: eq. (2)"),
        _formula(images, z, "PFI, three rotors", turning),
        fitted_curve(fit, z, "three rotors with body lift, fitted", "body_lift"),
        simulated=fit.data.points.simulated,
        basis="equal_rpm2",
    )


def _points(fit: FitOutput, label: str, role: Role = "measurement") -> RatioPoints:
    return ratio_points(fit, f"{label}, mean and sd over repeats", role)


def _formula(model: Model, z_over_R: Array, label: str, turning: Array | None = None) -> Curve:
    """Return a closed formula with the rig's own radius, all rotors turning unless said."""
    rig = model.rig
    speeds = np.ones(rig.n_rotors) if turning is None else turning
    conditions = Conditions.of(
        rig,
        speed_rad_s=500.0 * speeds,
        plate_z_m=z_over_R * rig.propulsion.radius_m,
        coverage=np.ones((rig.n_discs, 1)),
    )
    return Curve(z_over_R, np.asarray(model.factor(conditions), float), label)


def _distances(*fits: FitOutput) -> Array:
    farthest = max(float(np.nanmax(fit.data.z_over_R[fit.data.z_over_R < 9.0])) for fit in fits)
    return np.linspace(0.5, 1.06 * farthest, 240)


def _simulated(fits: Mapping[str, FitOutput]) -> bool:
    return any(fit.data.points.simulated for fit in fits.values())
