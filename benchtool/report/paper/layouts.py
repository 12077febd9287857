"""The ratio figures laid out as in the paper, from recipes of one's own runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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


def fits_of(recipes: Mapping[str, Path | None]) -> dict[str, FitOutput]:
    """Return the fits of the recipe folders that are given, by what they hold."""
    return {
        name: run_recipe(replace(read_recipe(folder), methods=("least_squares",), compare=()))
        for name, folder in recipes.items()
        if folder is not None
    }


def paper_layouts(recipes: Mapping[str, Path | None]) -> dict[str, FigureBlock]:
    """Return the figures that the recipe folders allow, by file name.

    Args:
        recipes: folders of `single` (one rotor: figures 3, 4 and 6), `second` (one rotor of
            another rig: figure 3), `three` (three rotors: figure 8) and `quad` (the quadrotor:
            figures 4 and 6); what is not given leaves its figures out.

    Raises:
        InputError: too little is given for any of them.
    """
    fits = fits_of(recipes)
    figures = drawn(LAYOUTS.name, fits, LAYOUTS.figures)
    if not figures:
        raise InputError(
            "nothing to draw: give --three for figure 8, --single with --second for figure 3, or "
            "--single with --quad for figures 4 and 6"
        )
    return figures


Line = tuple[str, str, str, Role]
"""Law of a curve ("eq2", "eq3", "eq4" or "fit"), of which recipe, its label and its role."""

EQ2 = "PFI, one rotor: eq. (2)"
QUAD: tuple[tuple[str, str, Role], ...] = (
    ("single", "one rotor", "single_rotor"),
    ("quad", "quadrotor", "quad"),
)


def measured_points(fits: Fits, measured: Sequence[tuple[str, str, Role]]) -> list[RatioPoints]:
    """Return the measured ratios of those recipes that were fitted; a label left out is the rig."""
    return [
        ratio_points(
            fits[name], f"{label or fits[name].fitted.rig.name}, mean and sd over repeats", role
        )
        for name, label, role in measured
        if name in fits
    ]


def _register(
    name: str,
    title: str,
    caption: str,
    measured: Sequence[tuple[str, str, Role]],
    lines: Sequence[Line],
) -> None:
    """Register a figure of measured ratios, by recipe, label and role, over curves."""

    def draw(figure: Figure, fits: Fits) -> None:
        z = [fits[name].data.z_over_R for name, *_ in measured]
        farthest = max(float(np.nanmax(each[each < 9.0])) for each in z)
        at = np.linspace(0.5, 1.06 * farthest, 240)
        series = measured_points(fits, measured)
        draw_ratio(figure, series, [_curve(line, fits, at) for line in lines], "equal_rpm2")

    figure(
        page="paper.layouts", name=name, title=title, caption=caption,
        when=lambda fits: {name for name, *_ in measured} <= set(fits),
    )(draw)  # fmt: skip


def _curve(line: Line, fits: Fits, z_over_R: Array) -> Curve:
    """Return the fitted curve, or a closed formula with the rig's own radius."""
    law, name, label, role = line
    if law == "fit":
        return fitted_curve(fits[name], z_over_R, label, role)
    model = Model.single(fits[name].fitted.rig)
    if law != "eq2":
        model = model.with_effect("neighbour_images")
    if law == "eq4":
        model = model.with_effect("body_lift", K_b=PAPER_K_B)
    turning = 3 if name == "three" else model.rig.n_rotors
    speeds = np.where(np.arange(model.rig.n_rotors) < turning, 500.0, 0.0)
    factor = np.asarray(factor_over(model, speeds[:, None], z_over_R), float)
    return Curve(z_over_R, factor, label, role)


_register(
    "fig03-two-rigs",
    "A single rotor near the ground, two rigs",
    "One rotor of each of two rigs over the PFI curve, eq. (2).",
    [("single", "", "single_rotor"), ("second", "", "second_rig")],
    [("eq2", "single", EQ2, "formula")],
)
_register(
    "fig04-quad-and-single",
    "A quadrotor against a single rotor",
    "A quadrotor and a single rotor over their PFI curves, eq. (3) and eq. (2).",
    QUAD,
    [("eq2", "single", EQ2, "formula"), ("eq3", "quad", "PFI, quadrotor: eq. (3)", "quad")],
)
_register(
    "fig06-body-lift",
    "A quadrotor with body lift",
    "A quadrotor and a single rotor over eq. (2), eq. (4) with K_b = 2, and the fit.",
    QUAD,
    [
        ("eq2", "single", EQ2, "formula"),
        ("eq4", "quad", f"body lift with K_b = {PAPER_K_B:g}: eq. (4)", "model"),
        ("fit", "quad", "eq. (4), fitted", "quad"),
    ],
)
_register(
    "fig08-three-rotors",
    "Three rotors of a quadrotor",
    "Three turning rotors of a quadrotor over eq. (2), their PFI curve without and with the share "
    "of the body lift that the flights grant them, and the fit.",
    [("three", "three rotors", "three_rotors")],
    [
        ("eq2", "three", EQ2, "formula"),
        ("eq3", "three", "PFI, three rotors", "three_rotors"),
        ("eq4", "three", f"with two thirds of K_b = {PAPER_K_B:g}", "quad"),
        ("fit", "three", "three rotors with body lift, fitted", "model"),
    ],
)

LAYOUTS = Page(
    "paper.layouts",
    [
        (
            "Your runs, laid out as in the paper",
            ["fig03-two-rigs", "fig04-quad-and-single", "fig06-body-lift", "fig08-three-rotors"],
        )
    ],
)
