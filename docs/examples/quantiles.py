"""Figure: residuals of a fit against a normal distribution."""

from __future__ import annotations

from matplotlib.figure import Figure
from scipy.stats import probplot

from benchtool.fit.run_recipe import FitOutput
from benchtool.report.figure import figure
from benchtool.report.fit.diagnostics import standardised


@figure(
    page="fit",
    title="Residuals against a normal distribution: {0.recipe.name}",
    caption="Standardised residuals in ascending order; normal residuals follow the line.",
    when=lambda fit: len(fit.data.rows) > 2,
)
def quantiles(figure: Figure, fit: FitOutput) -> None:
    """Draw a normal quantile plot of the residuals."""
    axes = figure.subplots()
    (normal, values), (slope, offset, _) = probplot(standardised(fit))
    axes.plot(normal, values, "o")
    axes.plot(normal, offset + slope * normal)
    axes.set_xlabel("normal quantile [–]")
    axes.set_ylabel("standardised residual [–]")
