"""The uncertainty budget of a fit: its tables and its bar chart."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from benchtool.core.plural import pluralize
from benchtool.fit.uncertainty.budget import COVERAGE, Budget
from benchtool.report.figure import figure
from benchtool.report.fit.tables import MOST_WANTED, wanted_rank
from benchtool.report.numbers import display_unit, format_number, with_unit
from benchtool.report.page import Block, Paragraph, Table
from benchtool.report.palette import BLACK, BLUE, ORANGE

SMALL = 0.03  # part of combined; smaller sources are left out: ten move it by half a per cent
INTERVAL = f"{100.0 * COVERAGE:.0f} %"


def shown_quantities(budget: Budget) -> list[int]:
    """Return the places of the quantities that a fit is made for, without nuisances."""
    ranked = sorted(range(len(budget.names)), key=lambda place: wanted_rank(budget.names[place]))
    wanted = [p for p in ranked if wanted_rank(budget.names[p]) < len(MOST_WANTED)]
    return wanted or ranked


def shown_lines(budget: Budget, quantities: Sequence[int]) -> list[int]:
    """Return the places of the sources that matter, the largest first."""
    share = np.max(budget.parts[:, quantities] / budget.combined[quantities], axis=1)
    return [int(row) for row in np.argsort(-share) if share[row] >= SMALL]


def budget_table(budget: Budget, *, short: bool = False) -> Table:
    """List what each source adds to each quantity; `short` leaves small ones out.

    In percent of the value, or in its unit where that is 0. "if halved": the quantity whose
    combined uncertainty falls most if the source's is halved, to first order.
    """
    places = shown_quantities(budget)[: 3 if short else None]
    lines = shown_lines(budget, places) if short else range(len(budget.lines))
    size = np.nan_to_num(budget.one_percent, nan=1.0)

    def shares(numbers: object) -> list[str]:
        return [format_number(float(one), ".2g") for one in (np.asarray(numbers) / size)[places]]

    fall = 1.0 - np.sqrt(1.0 - 0.75 * (budget.parts / budget.combined) ** 2)[:, places]
    most = [places[int(place)] for place in np.argmax(fall, axis=1)]
    halved = [
        f"{budget.names[place]} −{percent:.0f} %" if percent >= 0.5 else ""
        for place, percent in zip(most, 100.0 * fall.max(axis=1), strict=True)
    ]
    rows = [
        (_name(budget, row), _stated(budget, row), halved[row], *shares(budget.parts[row]))
        for row in lines
    ]

    def total(name: str, numbers: object) -> None:
        rows.append((name, "", "", *shares(numbers)))

    total("statistical, without *", budget.fit_sd)
    total("combined", budget.combined)
    total(f"expanded, {INTERVAL}", budget.expanded)
    rows.append(("coverage factor", "", "", *(f"{budget.coverage_factor[p]:.2f}" for p in places)))
    rows.append(("effective degrees of freedom", "", "", *(_dof(budget.dof[p]) for p in places)))
    if (drawn := budget.monte_carlo) is not None:
        total(f"Monte Carlo, {INTERVAL}: lower end", drawn.low)
        total("upper end", drawn.high)
    is_zero = np.isnan(budget.one_percent)
    units = (display_unit(budget.units[p]) if is_zero[p] else "%" for p in places)
    heads = (f"{budget.names[p]} [{unit}]" for p, unit in zip(places, units, strict=True))
    left_out = len(budget.lines) - len(lines)
    rest = f" {pluralize(left_out, 'smaller source')} left out." if left_out else ""
    return Table(
        f"Uncertainty budget: standard uncertainties in percent of the value.{rest}",
        ("source", "standard uncertainty", "if halved", *heads),
        rows,
        text_columns=3,
    )


MOST_DOF = 10_000.0  # above it Student's t is the normal distribution to four digits


def _dof(dof: float) -> str:
    return f"above {MOST_DOF:,.0f}" if dof > MOST_DOF else format_number(dof, ".0f")


def _name(budget: Budget, row: int) -> str:
    line = budget.lines[row]
    return line.name if line.in_fit else f"{line.name} *"


def _stated(budget: Budget, row: int) -> str:
    line = budget.lines[row]
    measured = " from residuals" if line.kind == "A" and not line.in_fit else ""
    return with_unit(f"{line.kind}: {line.sd:.2g}", line.unit) + measured


def budget_sentence(budget: Budget) -> str:
    """Say what the marks of the table mean, and whether Monte Carlo confirms it."""
    words = "* not in the statistical error: held by the model, error of its law, or misfit"
    if (drawn := budget.monte_carlo) is not None:
        places = shown_quantities(budget)
        off = [budget.names[place] for place in places if not budget.confirmed[place]]
        words += f". {drawn.draws} Monte Carlo refits (seed {drawn.seed}) " + (
            f"do not confirm the interval of {', '.join(off)}: take that of Monte Carlo"
            if off
            else "confirm the expanded intervals"
        )
    return ". ".join([words, *budget.traceability]) + "."


def budget_blocks(budget: Budget | None) -> list[Block]:
    """Return a budget for a page: contributions, sources, sensitivities, correlations."""
    if budget is None:
        return [Paragraph("There is no budget: the points leave a number open.")]
    places = shown_quantities(budget)
    names = [budget.names[place] for place in places]
    sources = Table(
        "Sources: who states or assumes each, and which points share it.",
        ("source", "type", "distribution", "correlation", "stated by", "u", "unit", "dof"),
        [
            (
                *(line.name, line.kind, line.distribution.replace("_", " "), line.correlation),
                *(line.origin or "–", f"{line.sd:.3g}", display_unit(line.unit)),
                f"{line.dof:.3g}" if isfinite(line.dof) else "∞",
            )
            for line in budget.lines
        ],
        text_columns=5,
    )
    sensitivities = Table(
        "Sensitivities: change of each quantity over that of the source, in their SI units.",
        ("source", *names),
        [
            (line.name, *(format_number(line.sensitivity[place], ".3g") for place in places))
            for line in budget.lines
        ],
    )
    correlations = Table(
        "Correlations of the quantities by all sources together.",
        ("", *names),
        [
            (budget.names[row], *(format_number(budget.correlation[row][p], ".2f") for p in places))
            for row in places
        ],
    )
    return [
        *(budget_table(budget), Paragraph(budget_sentence(budget))),
        *(sources, sensitivities, correlations),
    ]


@figure(
    title="Uncertainty budget: {0.recipe.name}",
    caption="What each source contributes to each quantity: standard uncertainty in percent of the "
    "value, in the fit's own standard error and beside it; dashed: all together.",
    when=lambda fit: fit.budget is not None,
    height_in=lambda fit: chart_height(fit.budget),
)
def budget(figure: Figure, subject: Any) -> None:
    """Draw the contributions of the largest sources to up to four quantities as bars."""
    budget: Budget = subject.budget
    places, lines = _drawn(budget)
    panels = figure.subplots(1, len(places), sharey=True, squeeze=False)[0]
    colors = [BLUE if budget.lines[row].in_fit else ORANGE for row in lines]
    for axes, place in zip(panels, places, strict=True):
        size = np.nan_to_num(budget.one_percent[place], nan=1.0)
        axes.barh(range(len(lines)), budget.parts[lines, place] / size, color=colors, height=0.7)
        axes.axvline(budget.combined[place] / size, color=BLACK, linestyle="--", linewidth=1.0)
        axes.set_title(fill(budget.names[place], max(12, 56 // len(places))))
        is_zero = np.isnan(budget.one_percent[place])
        unit = display_unit(budget.units[place])
        axes.set_xlabel(f"uncertainty [{unit}]" if is_zero else "percent of value")
    panels[0].set_yticks(range(len(lines)), [budget.lines[row].name for row in lines])
    panels[0].invert_yaxis()
    handles = [
        Patch(color=BLUE, label="in the fit's standard error"),
        Patch(color=ORANGE, label="not in it (* in the table)"),
        Line2D([], [], color=BLACK, linestyle="--", linewidth=1.0, label="combined"),
    ]
    figure.legend(handles=handles, loc="outside lower right", ncols=3)


def chart_height(budget: Budget) -> float:
    """Return inches for the bars of a budget."""
    return 1.9 + 0.26 * len(_drawn(budget)[1])


def _drawn(budget: Budget) -> tuple[list[int], list[int]]:
    places = shown_quantities(budget)[:4]
    return places, shown_lines(budget, places)
