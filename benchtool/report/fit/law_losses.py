"""Laws of thrust against distance: what each loses against the best."""

from __future__ import annotations

from matplotlib.figure import Figure

from benchtool.fit.run_recipe import FitOutput
from benchtool.report.figure import figure
from benchtool.report.fit.tables import scored_laws
from benchtool.report.palette import GREY


@figure(
    page="fit",
    name="laws",
    title="Laws on held-out distances: {0.recipe.name}",
    caption=(
        "Mean loss of log score per distance against the law that predicts best, two standard "
        "errors to either side, corrected for overlapping folds; 0 is the best. Refused laws are "
        "in the table."
    ),
    when=lambda fit: fit.laws is not None and len(scored_laws(fit.laws)) > 1,
)
def laws(figure: Figure, fit: FitOutput) -> None:
    """Draw the loss of every law that was scored, the best on top."""
    assert fit.laws is not None
    scores = scored_laws(fit.laws)
    axes = figure.subplots()
    rows = range(len(scores))
    axes.errorbar(
        [score.behind for score in scores],
        rows,
        xerr=[2.0 * score.behind_se for score in scores],
        fmt="o",
    )
    axes.axvline(0.0, color=GREY, lw=0.8)
    axes.set_yticks(rows, [f"{score.law}\n{score.verdict}" for score in scores])
    axes.invert_yaxis()
    axes.set_xscale("symlog", linthresh=1.0)
    axes.set_xlabel("log score lost per distance [–], bars of two standard errors")
    axes.set_ylabel("law")
