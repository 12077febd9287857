"""Panels and tables of quantities, whatever run or recording they are of."""

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

COLUMNS = 2  # panels beside each other


def panels_height(quantities: Sequence[object]) -> float:
    """Return inches for a panel of each quantity."""
    return 0.8 + 2.1 * ceil(len(quantities) / COLUMNS)


def quantity_panels(figure: Figure, quantities: Sequence[Quantity], label: str) -> list[Axes]:
    """Return a panel for each quantity, its axis labelled with symbol and unit."""
    rows = ceil(len(quantities) / COLUMNS)
    grid = figure.subplots(rows, COLUMNS, squeeze=False, sharex=True).ravel().tolist()
    for place, (axes, one) in enumerate(zip(grid, quantities, strict=False)):
        axes.set_title(one.title)
        axes.set_ylabel(re.sub(r"([A-Za-zη]+)_(\w+)", r"$\1_{\2}$", with_symbol(one)))
        if place >= len(quantities) - COLUMNS:
            axes.tick_params(labelbottom=True)
            axes.set_xlabel(label)
    for axes in grid[len(quantities) :]:
        axes.remove()
    return list(grid[: len(quantities)])


def with_symbol(quantity: Quantity) -> str:
    """Return "C_T [–]"."""
    return f"{quantity.symbol} [{display_unit(quantity.unit)}]"


def values_table(
    caption: str,
    rows: Sequence[Sequence[str]],
    header: Sequence[str],
    found: Sequence[QuantityValues],
) -> Table:
    """List every quantity with its standard error behind what names each row."""
    cells = [
        [
            value_with_sd(float(value), float(error)) if np.isfinite(value) else "–"
            for value, error in zip(one.value, one.total_error, strict=True)
        ]
        for one in found
    ]
    return Table(
        caption,
        (*header, *(with_symbol(one.quantity) for one in found)),
        [(*row, *(column[place] for column in cells)) for place, row in enumerate(rows)],
    )


def origins_table(quantities: Sequence[QuantityValues]) -> Table:
    """List formula, origin and error of each quantity: who made how much of it, in percent."""
    rows = []
    for one in quantities:
        size = np.abs(np.where(one.value != 0.0, one.value, np.nan))
        parts = {"own": one.standard_error}
        parts |= {
            source.name: np.sqrt(np.sum(source.columns**2, axis=1)) for source in one.error_sources
        }
        shares = {name: _median_percent(part, size) for name, part in parts.items()}
        words = ", ".join(f"{name} {format_number(share, '.2g')}" for name, share in shares.items())
        total = format_number(_median_percent(one.total_error, size), ".2g")
        quantity = one.quantity
        formula = quantity.formula if one.origin.startswith("from ") else "–"
        rows.append((quantity.title, quantity.symbol, formula, one.origin, words, total))
    return Table(
        "What each quantity is worked out from, and its standard error in percent of the value "
        "(median of the rows): what is its own at each row, then what all rows share.",
        ("quantity", "symbol", "formula", "origin", "errors [%]", "together [%]"),
        rows,
        text_columns=5,
    )


def _median_percent(part: np.ndarray, size: np.ndarray) -> float:
    shares = 100.0 * np.abs(part) / size
    shares = shares[np.isfinite(shares)]
    return float(np.median(shares)) if shares.size else float("nan")
