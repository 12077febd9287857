"""Uncertainty budget of a fit: tables and bar chart."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress
from math import isfinite
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from benchtool.core.text import pluralize
from benchtool.fit.uncertainty.budget import COVERAGE, Budget
from benchtool.report.figure import figure, legend_line, legend_patch
from benchtool.report.fit.tables import MAIN_PARAMETERS, wanted_rank
from benchtool.report.numbers import display_unit, format_number, with_unit
from benchtool.report.page import Block, Table
from benchtool.report.palette import BLACK, BLUE, ORANGE

if TYPE_CHECKING:
    from matplotlib.figure import Figure


SMALL = 0.03  # share of combined; omitted if smaller: ten such sources change it by 0.5 %
INTERVAL = f"{100.0 * COVERAGE:.0f} %"


def shown_quantities(budget: Budget) -> list[int]:
    """Return the indices of the main quantities of a fit, without nuisance parameters."""
    ranked = sorted(range(len(budget.names)), key=lambda index: wanted_rank(budget.names[index]))
    main = [index for index in ranked if wanted_rank(budget.names[index]) < len(MAIN_PARAMETERS)]
    return main or ranked


def shown_lines(budget: Budget, quantities: Sequence[int]) -> list[int]:
    """Return the row indices of non-negligible sources, largest first."""
    share = np.max(budget.parts[:, quantities] / budget.combined[quantities], axis=1)
    return [int(row) for row in np.argsort(-share) if share[row] >= SMALL]


def budget_table(budget: Budget, *, short: bool = False) -> Table:
    """Return a table of the contributions of sources to quantities; `short` omits small ones.

    In percent of the value, or in its unit if the value is 0. "if halved": the quantity whose
    combined uncertainty decreases most if that of the source is halved, to first order.
    """
    indices = shown_quantities(budget)[: 3 if short else None]
    lines = shown_lines(budget, indices) if short else range(len(budget.lines))
    is_zero, size = np.isnan(budget.one_percent), np.nan_to_num(budget.one_percent, nan=1.0)

    def shares(numbers: object) -> list[str]:
        return [
            format_number(float(number), ".2g") for number in (np.asarray(numbers) / size)[indices]
        ]

    reduction = 1.0 - np.sqrt(1.0 - 0.75 * (budget.parts / budget.combined) ** 2)[:, indices]
    most_reduced = [indices[int(column)] for column in np.argmax(reduction, axis=1)]
    halved = [
        f"{budget.names[index]} −{percent:.0f} %" if percent >= 0.5 else ""
        for index, percent in zip(most_reduced, 100.0 * reduction.max(axis=1), strict=True)
    ]
    rows = []
    for row in lines:
        line = budget.lines[row]
        source = with_unit(f"{line.kind}: {line.sd:.2g}", line.unit)
        if not line.in_fit and line.kind == "A":
            source += " from residuals"
        name = line.name if line.in_fit else f"{line.name} *"
        rows.append((name, source, halved[row], *shares(budget.parts[row])))

    def total(name: str, numbers: object) -> None:
        rows.append((name, "", "", *shares(numbers)))

    total("statistical, without *", budget.fit_sd)
    total("combined", budget.combined)
    total(f"expanded, {INTERVAL}", budget.expanded)
    rows.append(("coverage factor", "", "", *(f"{budget.coverage_factor[p]:.2f}" for p in indices)))
    rows.append(("effective degrees of freedom", "", "", *(_dof(budget.dof[p]) for p in indices)))
    if (monte_carlo := budget.monte_carlo) is not None:
        total(f"Monte Carlo, {INTERVAL}: lower end", monte_carlo.low)
        total("upper end", monte_carlo.high)
    heads = [
        f"{budget.names[p]} [{display_unit(budget.units[p]) if is_zero[p] else '%'}]"
        for p in indices
    ]
    n_omitted = len(budget.lines) - len(lines)
    omitted = f" {pluralize(n_omitted, 'smaller source')} omitted." if n_omitted else ""
    return Table(
        f"Uncertainty budget: standard uncertainties in percent of the value.{omitted}",
        ("source", "standard uncertainty", "if halved", *heads),
        rows,
        text_columns=3,
    )


def main_sources(budget: Budget | None) -> list[str]:
    """Return a sentence for each source outside the fit with most of a quantity's variance."""
    sentences: list[str] = []
    if budget is None:
        return sentences
    for line, parts in zip(budget.lines, budget.parts, strict=True):
        names = compress(budget.names, 2.0 * parts**2 > budget.combined**2)
        if (text := ", ".join(names)) and not line.in_fit:
            u = with_unit(f"{line.sd:.2g}", line.unit)
            remedy = "; state its tolerance or prior in a model file" * ("." in line.name)
            sentences.append(f"{text}: most of ± is {line.name}, {u} ({line.origin}){remedy}")
    return sentences


MAX_DOF = 10_000.0  # above it Student's t equals the normal distribution to four digits


def _dof(dof: float) -> str:
    return f"above {MAX_DOF:,.0f}" if dof > MAX_DOF else format_number(dof, ".0f")


def budget_sentence(budget: Budget) -> str:
    """Return a legend of the table's marks, and the confirmation by Monte Carlo if there is one."""
    text = "* not in the statistical error: fixed by the model, error of its law, or misfit"
    if (monte_carlo := budget.monte_carlo) is not None:
        indices = shown_quantities(budget)
        unconfirmed = [budget.names[index] for index in indices if not budget.confirmed[index]]
        text += f". {monte_carlo.draws} Monte Carlo refits (seed {monte_carlo.seed}) " + (
            f"do not confirm the interval of {', '.join(unconfirmed)}; use the Monte Carlo interval"
            if unconfirmed
            else "confirm the expanded intervals"
        )
    return ". ".join([text, *budget.traceability]) + "."


def budget_blocks(budget: Budget | None) -> list[Block]:
    """Return the blocks of a budget: contributions, sources, sensitivities, correlations."""
    if budget is None:
        return ["No budget: the points do not determine all parameters."]
    indices = shown_quantities(budget)
    names = [budget.names[index] for index in indices]
    sources = Table(
        "Sources: origin of each value, and the points that share its error.",
        ("source", "type", "distribution", "correlation", "origin", "u", "unit", "dof"),
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
        "Sensitivities: derivative of each quantity with respect to the source, in SI units.",
        ("source", *names),
        [
            (line.name, *(format_number(line.sensitivity[index], ".3g") for index in indices))
            for line in budget.lines
        ],
    )
    matrix = np.array(budget.correlation)[np.ix_(indices, indices)]
    correlations = Table(
        "Correlations of the quantities from all sources.",
        ("", *names),
        [
            (name, *(format_number(value, ".2f") for value in row))
            for name, row in zip(names, matrix, strict=True)
        ],
    )
    summary = budget_table(budget), budget_sentence(budget)
    return [*summary, sources, sensitivities, correlations]


def budget(figure: Figure, subject: Any) -> None:
    """Draw contributions of the largest sources to up to four quantities."""
    budget: Budget = subject.budget
    indices = shown_quantities(budget)[:4]
    lines = shown_lines(budget, indices)
    panels = figure.subplots(1, len(indices), sharey=True, squeeze=False)[0]
    colors = [BLUE if budget.lines[row].in_fit else ORANGE for row in lines]
    for axes, index in zip(panels, indices, strict=True):
        size = np.nan_to_num(budget.one_percent[index], nan=1.0)
        axes.barh(range(len(lines)), budget.parts[lines, index] / size, color=colors, height=0.7)
        axes.axvline(budget.combined[index] / size, color=BLACK, linestyle="--", linewidth=1.0)
        axes.set_title(fill(budget.names[index], max(12, 56 // len(indices))))
        is_zero = np.isnan(budget.one_percent[index])
        unit = display_unit(budget.units[index])
        axes.set_xlabel(f"uncertainty [{unit}]" if is_zero else "percent of value")
    panels[0].set_yticks(range(len(lines)), [budget.lines[row].name for row in lines])
    panels[0].invert_yaxis()
    handles = [
        legend_patch(color=BLUE, label="included in the fit's standard error"),
        legend_patch(color=ORANGE, label="not included (* in the table)"),
        legend_line(color=BLACK, linestyle="--", linewidth=1.0, label="combined"),
    ]
    figure.legend(handles=handles, loc="outside lower right", ncols=3)


def chart_height(budget: Budget) -> float:
    """Return the height of the bar chart in inches."""
    return 1.9 + 0.26 * len(shown_lines(budget, shown_quantities(budget)[:4]))


figure(
    title="Uncertainty budget: {0.recipe.name}",
    caption="Contributions of sources to quantities: standard uncertainty in percent of the value, "
    "included in the fit's standard error or not; dashed: combined.",
    when=lambda fit: fit.budget is not None,
    height_in=lambda subject: chart_height(subject.budget),
)(budget)
