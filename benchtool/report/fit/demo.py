"""The demo's story: eq. (2) holds for one rotor, eq. (3) falls short for four, K_b is needed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchtool import __version__
from benchtool.data.run.read import read_samples
from benchtool.fit.recipe import Method, Recipe
from benchtool.fit.run_recipe import FitOutput, Progress, run_recipe
from benchtool.physics.model_file import load_model
from benchtool.report.figure import Page, figure
from benchtool.report.fit.figures import fitted_curve, ratio_points
from benchtool.report.fit.page import comparison_table, fit_sections
from benchtool.report.fit.tables import methods_table, printed
from benchtool.report.page import Block, Commands, Paragraph, Report, Section
from benchtool.report.ratio import draw_ratio
from benchtool.report.sweep.samples import draw_samples, samples_height

TRUTHS = {"single": "virtual_pquad_single", "quad": "virtual_pquad"}
"""Which shipped truth each virtual bench of the demo is made of."""


@dataclass(frozen=True, slots=True, eq=False)
class Story:
    """Hold the demo's fits.

    Attributes:
        single: one rotor, eq. (2).
        eq3: four rotors without body lift.
        eq4: four rotors with body lift, held against eq. (3) on held-out points.
    """

    single: FitOutput
    eq3: FitOutput
    eq4: FitOutput


def fit_both(
    single_run: Path, quad_run: Path, progress: Progress = lambda what, done, expected: None
) -> Story:
    """Fit the demo's two runs."""
    both: tuple[Method, ...] = ("least_squares", "emcee")
    single = Recipe(name="one rotor", data=(str(single_run),), model="single_bench", methods=both)
    eq4 = Recipe(
        name="four rotors, eq. (4)",
        data=(str(quad_run),),
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
    return Story(run_recipe(single, progress), run_recipe(eq3, progress), run_recipe(eq4, progress))


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


def _opening(story: Story) -> list[Block]:
    return [
        Paragraph(
            "Two virtual benches answered over a serial link: one rotor of the PQUAD, and the "
            "whole quadrotor. A plate was moved under them and thrust, speed and pulse were "
            "logged. " + verdict(story)
        )
    ]


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


STORY = Page("fit.demo", [("The story", [_opening, "overview", _tables])])

SWEEPS = Page("fit.demo_sweeps", [("The sweeps", ["samples"])])


def story_page(
    story: Story, runs: Mapping[str, Path], commands: Sequence[str], made: str = ""
) -> Report:
    """Return the demo's report page."""
    eq4 = story.eq4.results[0]
    return Report(
        title="From a plate sweep to a fitted ground-effect model",
        summary=verdict(story),
        sections=(
            *STORY.sections(story),
            *fit_sections(story.eq4),
            *fit_sections(story.single),
            *SWEEPS.sections(runs),
            Section("Made with", [Commands(commands)]),
        ),
        simulated=True,
        made=made or f"benchtool {__version__}",
        highlights={
            "K_b": printed(eq4["body_lift.K_b"]),
            "R [m]": printed(eq4["R_m"]),
            "chi2/dof, eq. (3)": f"{story.eq3.results[0].chi2_per_dof:.3g}",
            "chi2/dof, eq. (4)": f"{eq4.chi2_per_dof:.2g}",
        },
    )


@figure(
    page="fit.demo",
    name="overview",
    title="Four rotors need the body lift",
    caption="Thrust near the plate over thrust far from it, for one rotor and for four, with the "
    "closed formulae (dashed) and the fit of eq. (4) with its bands.",
    simulated=True,
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
