"""The demo's story: eq. (2) holds for one rotor, eq. (3) falls short for four, K_b is needed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from benchtool.data.run.read import read_samples
from benchtool.fit.recipe import Method, Recipe
from benchtool.fit.run_recipe import FitOutput, Progress, run_recipe
from benchtool.physics.model_file import load_model
from benchtool.report.figure import Page, figure
from benchtool.report.fit.figures import fitted_curve, ratio_points
from benchtool.report.fit.page import FIT
from benchtool.report.fit.tables import comparison_table, methods_table, printed
from benchtool.report.page import Block, Paragraph
from benchtool.report.ratio import draw_ratio
from benchtool.report.sweep.samples import draw_samples, samples_height

TRUTHS = {"single": "virtual_pquad_single", "quad": "virtual_pquad"}
"""Which shipped truth each virtual bench of the demo is made of."""


class Story(NamedTuple):
    """Hold the demo's fits: eq. (2) of one rotor, eq. (3) and eq. (4) of four, and the runs."""

    single: FitOutput
    eq3: FitOutput
    eq4: FitOutput
    runs: Mapping[str, Path] = MappingProxyType({})
    simulated: bool = True


def fit_both(
    runs: Mapping[str, Path], progress: Progress = lambda what, done, expected: None
) -> Story:
    """Fit the demo's runs, "single" and "quad"."""
    both: tuple[Method, ...] = ("least_squares", "emcee")
    single, quad = str(runs["single"]), str(runs["quad"])
    eq2 = Recipe(name="one rotor", data=(single,), model="single_bench", methods=both)
    eq4 = Recipe(
        name="four rotors, eq. (4)",
        data=(quad,),
        model="quad_bench",
        methods=both,
        compare=("single", "quad"),
    )
    eq3 = replace(
        eq4,
        name="four rotors, eq. (3)",
        methods=("least_squares",),
        compare=(),
        fix={"body_lift.K_b": 0.0},
    )
    fits = (run_recipe(each, progress) for each in (eq2, eq3, eq4))
    return Story(next(fits), next(fits), next(fits), runs)


def verdict(story: Story) -> str:
    """Say in a few sentences what came out."""
    single, eq3, eq4 = story.single.results[0], story.eq3.results[0], story.eq4.results[0]
    lift = eq4["body_lift.K_b"]
    true = true_values("quad")["body_lift.K_b"]
    return (
        f"One rotor follows eq. (2): chi2/dof = {single.chi2_per_dof:.2g}. Four rotors do not "
        f"follow eq. (3): chi2/dof = {eq3.chi2_per_dof:.3g}. With the body lift of eq. (4) it is "
        f"{eq4.chi2_per_dof:.2g}, and K_b = {printed(lift)} (the virtual "
        f"bench was made with {true:g})."
    )


def true_values(which: str) -> dict[str, float]:
    """Return the numbers that a virtual bench of the demo was made with."""
    model = load_model(TRUTHS[which]).model
    return {
        name: item.value for name, item in model.parameters.items() if not name.startswith("noise.")
    }


def _opening(story: Story) -> Block:
    return Paragraph(
        "Two virtual benches answered over a serial link: one rotor of the PQUAD, and the whole "
        "quadrotor. A plate was moved under them and thrust, speed and pulse were logged. "
        + verdict(story)
    )


def _tables(story: Story) -> list[Block]:
    return [
        comparison_table(story.eq4.comparison) if story.eq4.comparison else Paragraph(""),
        methods_table(
            story.eq4.results,
            true_values("quad"),
            "Four rotors: both estimators beside the numbers that the bench was made with.",
        ),
        methods_table(story.single.results, true_values("single"), "One rotor: the same."),
    ]


def _highlights(story: Story) -> dict[str, str]:
    eq3, eq4 = story.eq3.results[0], story.eq4.results[0]
    return {
        "K_b": printed(eq4["body_lift.K_b"]),
        "R [m]": printed(eq4["R_m"]),
        "chi2/dof, eq. (3)": f"{eq3.chi2_per_dof:.3g}",
        "chi2/dof, eq. (4)": f"{eq4.chi2_per_dof:.2g}",
    }


SWEEPS = Page("fit.demo_sweeps", [("The sweeps", ["samples"])])

STORY = Page(
    "fit.demo",
    [
        ("The story", [_opening, "overview", _tables]),
        lambda story: FIT.sections(story.eq4),
        lambda story: FIT.sections(story.single),
        lambda story: SWEEPS.sections(story.runs),
    ],
    title="From a plate sweep to a fitted ground-effect model",
    summary=verdict,
    highlights=_highlights,
)


@figure(
    page="fit.demo",
    name="overview",
    title="Four rotors need the body lift",
    caption="Thrust near the plate over thrust far from it, for one rotor and for four, with the "
    "closed formulae (dashed) and the fit of eq. (4) with its bands.",
)
def overview(figure: Figure, story: Story) -> None:
    """Draw one rotor and four over eq. (2), eq. (3) and the fit of eq. (4)."""
    z = np.linspace(0.5, 3.4, 240)
    eq2 = fitted_curve(story.single, z, "eq. (2), fitted to one rotor", "single_rotor")
    eq3 = fitted_curve(story.eq3, z, "eq. (3), best it can do", "quad")
    series = [
        ratio_points(story.single, "one rotor (simulated bench)", "single_rotor"),
        ratio_points(story.eq4, "four rotors (simulated bench)", "quad"),
    ]
    curves = [
        replace(eq2, bands=()),
        replace(eq3, style="formula", bands=()),
        fitted_curve(story.eq4, z, "eq. (4), fitted", "model"),
    ]
    draw_ratio(figure, series, curves, "equal_rpm2")


@figure(
    page="fit.demo_sweeps",
    name="samples",
    title=lambda runs, run: f"The sweep of {run[0]}",
    caption=lambda runs, run: (
        f"Every sample of {run[1].name}: thrust, speed, pulse and plate distance."
    ),
    each=lambda runs: {name: (name, path) for name, path in runs.items()},
    height_in=lambda runs, run: samples_height(read_samples(run[1])),
    simulated=True,
)
def samples(figure: Figure, runs: Mapping[str, Path], run: tuple[str, Path]) -> None:
    """Draw every sample of one of the demo's runs."""
    draw_samples(figure, read_samples(run[1]))
