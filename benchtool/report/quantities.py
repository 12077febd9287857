"""Panels and tables of derived quantities of runs and recordings."""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import ceil

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchtool.data.derived import QuantityValues
from benchtool.data.quantities import Quantity
from benchtool.report.numbers import display_unit, format_number, value_with_sd
from benchtool.report.page import Table

COLUMNS = 2  # panels per row


def panels_height(quantities: Sequence[object]) -> float:
    """Return the figure height in inches for one panel per quantity."""
    return 0.8 + 2.1 * ceil(len(quantities) / COLUMNS)


def quantity_panels(figure: Figure, quantities: Sequence[Quantity], label: str) -> list[Axes]:
    """Return one panel per quantity; y axes are labelled with symbol and unit."""
    rows = ceil(len(quantities) / COLUMNS)
    grid = figure.subplots(rows, COLUMNS, squeeze=False, sharex=True).ravel().tolist()
    for index, (axes, quantity) in enumerate(zip(grid, quantities, strict=False)):
        axes.set_title(quantity.title)
        axes.set_ylabel(re.sub(r"([A-Za-zη]+)_(\w+)", r"$\1_{\2}$", with_symbol(quantity)))
        if index >= len(quantities) - COLUMNS:
            axes.tick_params(labelbottom=True)
            axes.set_xlabel(label)
    for axes in grid[len(quantities) :]:
        axes.remove()
    return list(grid[: len(quantities)])


def with_symbol(quantity: Quantity) -> str:
    """Return symbol and unit, for example "C_T [–]"."""
    return f"{quantity.symbol} [{display_unit(quantity.unit)}]"


def values_table(
    caption: str,
    rows: Sequence[Sequence[str]],
    header: Sequence[str],
    quantities: Sequence[QuantityValues],
) -> Table:
    """Return a table of quantities with standard errors; `rows` are the leading cells."""
    cells = [
        [
            value_with_sd(float(value), float(error)) if np.isfinite(value) else "–"
            for value, error in zip(quantity.value, quantity.total_error, strict=True)
        ]
        for quantity in quantities
    ]
    return Table(
        caption,
        (*header, *(with_symbol(quantity.quantity) for quantity in quantities)),
        [(*row, *(column[row_index] for column in cells)) for row_index, row in enumerate(rows)],
    )


def origins_table(quantities: Sequence[QuantityValues]) -> Table:
    """Return a table of formula, origin and error contributions (percent) of each quantity."""
    rows = []
    for values in quantities:
        size = np.abs(np.where(values.value != 0.0, values.value, np.nan))
        parts = {"own": values.standard_error}
        parts |= {
            source.name: np.sqrt(np.sum(source.columns**2, axis=1))
            for source in values.error_sources
        }
        shares = {name: _median_percent(part, size) for name, part in parts.items()}
        contributions = ", ".join(
            f"{name} {format_number(share, '.2g')}" for name, share in shares.items()
        )
        total = format_number(_median_percent(values.total_error, size), ".2g")
        quantity = values.quantity
        formula = quantity.formula if values.origin.startswith("from ") else "–"
        rows.append((quantity.title, quantity.symbol, formula, values.origin, contributions, total))
    return Table(
        "Origin of each quantity and its standard error in percent of the value (median of the "
        "rows): independent part (own), then errors shared by all rows.",
        ("quantity", "symbol", "formula", "origin", "errors [%]", "together [%]"),
        rows,
        text_columns=5,
    )


def _median_percent(part: np.ndarray, size: np.ndarray) -> float:
    shares = 100.0 * np.abs(part) / size
    shares = shares[np.isfinite(shares)]
    return float(np.median(shares)) if shares.size else float("nan")
