"""The ratio figures laid out as in the paper, from recipes of one's own runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchtool.core.array import Array
from benchtool.core.errors import InputError
from benchtool.fit.recipe import read_recipe
from benchtool.fit.run_recipe import FitOutput, run_recipe
from benchtool.physics.model import Model
from benchtool.report.figure import Page, drawn, figure
from benchtool.report.fit.figures import fitted_curve, ratio_points
from benchtool.report.page import FigureBlock
from benchtool.report.palette import Role
from benchtool.report.ratio import Curve, RatioPoints, draw_ratio, factor_over

Fits = Mapping[str, FitOutput]

PAPER_K_B = 2.0
"""Body lift coefficient of the paper's figure 6 ("with K_b = 2")."""


def paper_layouts(recipes: Mapping[str, Path | None]) -> dict[str, FigureBlock]:
    """Return the figures that the recipe folders allow, by file name.

    Args:
        recipes: folders of `single` (one rotor: figures 3, 4 and 6), `second` (one rotor of
            another rig: figure 3), `three` (three rotors: figure 8) and `quad` (the quadrotor:
            figures 4 and 6); what is not given leaves its figures out.

    Raises:
        InputError: too little is given for any of them.
    """
    fits = {
        name: run_recipe(replace(read_recipe(folder), methods=("least_squares",), compare=()))
        for name, folder in recipes.items()
        if folder is not None
    }
    figures = drawn(LAYOUTS.name, fits, LAYOUTS.figures)
    if not figures:
        raise InputError(
            "nothing to draw: give --three for figure 8, --single with --second for figure 3, or "
            "--single with --quad for figures 4 and 6"
        )
    return figures


def _given(*names: str) -> Callable[[Fits], bool]:
    return lambda fits: set(names) <= set(fits)


def _simulated(fits: Fits) -> bool:
    return any(fit.simulated for fit in fits.values())


@figure(
    page="paper.layouts",
    name="fig03-two-rigs",
    title="A single rotor near the ground, two rigs",
    caption="One rotor of each of two rigs over the PFI curve, eq. (2).",
    when=_given("single", "second"),
    simulated=_simulated,
)
def two_rigs(figure: Figure, fits: Fits) -> None:
    """Draw figure 3."""
    first, second = fits["single"], fits["second"]
    z = _distances(first, second)
    series = [
        _points(first, first.fitted.rig.name, "single_rotor"),
        _points(second, second.fitted.rig.name, "second_rig"),
    ]
    draw_ratio(figure, series, [_one_rotor(first, z)], "equal_rpm2")


@figure(
    page="paper.layouts",
    name="fig04-quad-and-single",
    title="A quadrotor against a single rotor",
    caption="A quadrotor and a single rotor over their PFI curves, eq. (3) and eq. (2).",
    when=_given("single", "quad"),
    simulated=_simulated,
)
def quad_and_single(figure: Figure, fits: Fits) -> None:
    """Draw figure 4."""
    z, quad = _distances(fits["single"], fits["quad"]), _images(fits["quad"])
    curves = [_one_rotor(fits["single"], z), _formula(quad, z, "PFI, quadrotor: eq. (3)", "quad")]
    draw_ratio(figure, _single_and_quad(fits), curves, "equal_rpm2")


@figure(
    page="paper.layouts",
    name="fig06-body-lift",
    title="A quadrotor with body lift",
    caption="A quadrotor and a single rotor over eq. (2), eq. (4) with K_b = 2, and the fit.",
    when=_given("single", "quad"),
    simulated=_simulated,
)
def body_lift(figure: Figure, fits: Fits) -> None:
    """Draw figure 6."""
    z = _distances(fits["single"], fits["quad"])
    lifted = _images(fits["quad"]).with_effect("body_lift", K_b=PAPER_K_B)
    label = f"body lift with K_b = {PAPER_K_B:g}: eq. (4)"
    curves = [
        _one_rotor(fits["single"], z),
        _formula(lifted, z, label, "model"),
        fitted_curve(fits["quad"], z, "eq. (4), fitted", "quad"),
    ]
    draw_ratio(figure, _single_and_quad(fits), curves, "equal_rpm2")


@figure(
    page="paper.layouts",
    name="fig08-three-rotors",
    title="Three rotors of a quadrotor",
    caption="Three turning rotors of a quadrotor over eq. (2), their PFI curve, and the fit.",
    when=_given("three"),
    simulated=lambda fits: fits["three"].simulated,
)
def three_rotors(figure: Figure, fits: Fits) -> None:
    """Draw figure 8."""
    fit = fits["three"]
    z = _distances(fit)
    turning = np.array([1.0, 1.0, 1.0, 0.0])[: fit.fitted.rig.n_rotors]
    curves = [
        _one_rotor(fit, z),
        _formula(_images(fit), z, "PFI, three rotors", "three_rotors", turning),
        fitted_curve(fit, z, "three rotors with body lift, fitted", "model"),
    ]
    draw_ratio(figure, [_points(fit, "three rotors", "three_rotors")], curves, "equal_rpm2")


LAYOUTS = Page(
    "paper.layouts",
    [
        (
            "Your runs, laid out as in the paper",
            ["fig03-two-rigs", "fig04-quad-and-single", "fig06-body-lift", "fig08-three-rotors"],
        )
    ],
)


def _points(fit: FitOutput, label: str, role: Role) -> RatioPoints:
    return ratio_points(fit, f"{label}, mean and sd over repeats", role)


def _single_and_quad(fits: Fits) -> list[RatioPoints]:
    return [
        _points(fits["single"], "one rotor", "single_rotor"),
        _points(fits["quad"], "quadrotor", "quad"),
    ]


def _images(fit: FitOutput) -> Model:
    return Model.single(fit.fitted.rig).with_effect("neighbour_images")


def _one_rotor(fit: FitOutput, z_over_R: Array) -> Curve:
    single = Model.single(fit.fitted.rig)
    return _formula(single, z_over_R, "PFI, one rotor: eq. (2)", "formula")


def _formula(
    model: Model, z_over_R: Array, label: str, role: Role, turning: Array | None = None
) -> Curve:
    """Return a closed formula with the rig's own radius, all rotors turning unless said."""
    speeds = 500.0 * (np.ones(model.rig.n_rotors) if turning is None else turning)
    factor = np.asarray(factor_over(model, speeds[:, None], z_over_R), float)
    return Curve(z_over_R, factor, label, role)


def _distances(*fits: FitOutput) -> Array:
    farthest = max(float(np.nanmax(fit.data.z_over_R[fit.data.z_over_R < 9.0])) for fit in fits)
    return np.linspace(0.5, 1.06 * farthest, 240)
