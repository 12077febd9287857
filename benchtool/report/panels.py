"""Common parts of pages: figure elements, and panels and tables of derived quantities."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from itertools import pairwise
from math import ceil, nan
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.units import Array, from_si
from benchtool.data.derived import QuantityValues
from benchtool.data.quantities import Quantity
from benchtool.report.figure import legend_line
from benchtool.report.numbers import display_unit, format_number, value_with_sd
from benchtool.report.page import Table
from benchtool.report.palette import CYCLE, GREY, OVER, PALE

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def stack_panels(
    figure: Figure,
    heights: Sequence[float],
    labels: Collection[str] = (),
    xlabel: str = "",
    *,
    sharex: bool = True,
    sharey: bool = False,
) -> list[Axes]:
    """Return stacked panels of relative heights, with the label of x and aligned labels of y."""
    grid = figure.subplots(
        len(heights), 1, sharex=sharex, sharey=sharey, squeeze=False,
        gridspec_kw={"height_ratios": list(heights)},
    )  # fmt: skip
    panels = list(grid[:, 0])
    panels[-1].set_xlabel(xlabel)
    for axes, label in zip(panels, labels, strict=False):
        axes.set_ylabel(label)
    if labels:
        figure.align_ylabels(panels)
    return panels


def points(
    axes: Axes, x: Any, y: Any, error: Any, color: str, marker: str = "o", **look: Any
) -> None:
    """Draw points with error bars; an error of nan draws none."""
    axes.errorbar(x, y, yerr=error, fmt=marker, color=color, **{"ms": 4.6, **look})


def spread(axes: Axes, half: float, gid: str | None = None, alpha: float | None = None) -> None:
    """Draw the zero line and a band of ± `half` around it, if `half` is finite."""
    if np.isfinite(half):
        axes.axhspan(-half, half, color=PALE, alpha=alpha, linewidth=0.0, zorder=0.4, gid=gid)
    axes.axhline(0.0, color=GREY, linewidth=0.9)


def spans(time_s: Array, inside: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return start and end time of every interval in which `inside` is True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(np.int8), [0]])))
    last = len(time_s) - 1
    return [
        (float(time_s[begin]), float(time_s[min(end, last)]))
        for begin, end in zip(edges[::2], edges[1::2], strict=True)
    ]


def shade(axes: Axes, intervals: Iterable[tuple[float, float]], gid: str = "over-surface") -> None:
    """Shade the background of time intervals in which a rotor is over a surface."""
    for begin, end in intervals:
        axes.axvspan(begin, end, color=OVER, linewidth=0.0, zorder=0.4, gid=gid)


def envelope(time_s: Array, values: Array, slots: int = 900) -> tuple[Array, Array]:
    """Decimate a signal to minimum and maximum of every slot, without nan; spikes remain."""
    present = np.isfinite(values) & np.isfinite(time_s)
    time_s, values = time_s[present], values[present]
    if values.size <= 2 * slots:
        return time_s, values
    edges = np.linspace(0, values.size, slots + 1).astype(int)
    indices: set[int] = {0, values.size - 1}
    for start, end in pairwise(edges):
        slot_values = values[start:end]
        indices.update((start + int(slot_values.argmin()), start + int(slot_values.argmax())))
    order = np.array(sorted(indices))
    return time_s[order], values[order]


def broken_line(axes: Axes, time_s: Array, values: Array, **look: Any) -> None:
    """Draw a signal decimated by `envelope`, interrupted where it is nan."""
    finite = np.isfinite(values)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], finite.astype(np.int8), [0]])))
    slots = max(40, int(900 / max(len(edges) // 2, 1)))
    times, drawn = [np.empty(0)], [np.empty(0)]
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        decimated = envelope(time_s[begin:end], values[begin:end], slots)
        times += [decimated[0], np.array([np.nan])]
        drawn += [decimated[1], np.array([np.nan])]
    axes.plot(np.concatenate(times), np.concatenate(drawn), **look)


def in_radii(axes: Axes, radius_m: float) -> None:
    """Add an axis in z/R on the right of a plate distance in mm."""
    in_mm = from_si(radius_m, "mm")
    functions = (lambda z_mm: z_mm / in_mm, lambda ratio: ratio * in_mm)
    axes.secondary_yaxis("right", functions=functions).set_ylabel("$z/R$ [–]")


def rotor_color(rotor: int) -> str:
    """Return the colour of a numbered rotor, counted from 0."""
    return CYCLE[rotor % len(CYCLE)]


def rotor_legend(axes: Axes, rotors: int) -> None:
    """Add a legend of rotor colours above a panel; none for one rotor."""
    labels = ["rotor 1", *map(str, range(2, rotors + 1))] if rotors > 1 else []
    lines = [legend_line(color=rotor_color(k), label=label) for k, label in enumerate(labels)]
    legend_over(axes, lines)


def legend_over(axes: Axes, handles: Sequence[Artist]) -> None:
    """Add a one-row legend above a panel, outside the axes."""
    if handles:
        axes.legend(
            handles=handles, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=len(handles),
            frameon=False, fontsize=8.2, handlelength=1.2, columnspacing=1.4, borderaxespad=0.1,
        )  # fmt: skip


def legend_below(figure: Figure, axes: Sequence[Axes], ncols: int, **replacements: Artist) -> None:
    """Add one legend of all axes below the figure; `replacements` by label, with _ for a blank."""
    handles: dict[str, Any] = {}
    for panel in axes:
        panel_handles, labels = panel.get_legend_handles_labels()
        handles |= dict(zip(labels, panel_handles, strict=True))
    handles |= {label.replace("_", " "): handle for label, handle in replacements.items()}
    figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=ncols)


def named_rows(
    axes: Axes,
    names: Sequence[str],
    marked: Iterable[str] = (),
    *,
    bottom: float = 0.4,
    top: float = 0.6,
) -> None:
    """Label the rows of horizontal bars from top to bottom, marked rows in bold."""
    bold = set(marked)
    axes.set_yticks(range(len(names)), list(names))
    for label, name in zip(axes.get_yticklabels(), names, strict=True):
        label.set_fontweight("bold" if name in bold else "normal")
    axes.set_ylim(len(names) - bottom, -top)
    axes.grid(visible=False, axis="y")


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
    for item in quantities:
        size = np.abs(np.where(item.value != 0.0, item.value, np.nan))
        parts = {"own": item.standard_error}
        parts |= {
            source.name: np.sqrt(np.sum(source.columns**2, axis=1)) for source in item.error_sources
        }
        shares = [f"{name} {_median_percent(part, size)}" for name, part in parts.items()]
        formula = item.quantity.formula if item.origin.startswith("from ") else "–"
        rows.append((
            item.quantity.title, item.quantity.symbol, formula, item.origin, ", ".join(shares),
            _median_percent(item.total_error, size),
        ))  # fmt: skip
    return Table(
        "Origin of each quantity and its standard error in percent of the value (median of the "
        "rows): independent part (own), then errors shared by all rows.",
        ("quantity", "symbol", "formula", "origin", "errors [%]", "together [%]"),
        rows,
        text_columns=5,
    )


def _median_percent(part: Array, size: Array) -> str:
    shares = 100.0 * np.abs(part) / size
    shares = shares[np.isfinite(shares)]
    return format_number(float(np.median(shares)) if shares.size else nan, ".2g")
