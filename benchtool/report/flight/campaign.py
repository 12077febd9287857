"""Maps of campaigns: one measure over one or two varied numbers, panels side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchtool.core.errors import InputError
from benchtool.report.palette import BLACK, BLUE, PALE, VERMILION
from benchtool.report.style import WIDTH_IN, new_figure, styled

Array = NDArray[np.float64]

SHARES = LinearSegmentedColormap.from_list("shares", [VERMILION, "#f3ece2", BLUE])
"""None is orange, all is blue: apart under every common colour-vision deficiency."""

MANY_CELLS = 1000
"""Cells of a panel above which a map is an image, even in a vector file, without lines between."""

LEGIBLE_IN = (0.26, 0.13)
"""Width and height of the smallest cell that takes a number, inches."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CampaignPanel:
    """Hold the runs of one panel, summed up in cells.

    Attributes:
        row, column: headings of its row and column of panels.
        x_edges, y_edges: of the cells (nx + 1,), (ny + 1,); y None where one number was varied.
        count, total, least, most: of the measure in each cell (ny, nx).
    """

    row: str
    column: str
    x_edges: Array
    y_edges: Array | None
    count: Array
    total: Array
    least: Array
    most: Array

    @property
    def means(self) -> Array:
        """Mean of each cell (ny, nx); nan where there is no run with a value."""
        mean: Array = np.full(self.count.shape, np.nan)
        np.divide(self.total, self.count, out=mean, where=self.count > 0.0)
        return mean


@styled
def campaign_figure(
    panels: Sequence[CampaignPanel],
    names: Sequence[str],
    measure: str,
    *,
    title: str,
    share: bool = False,
    note: str = "",
    values: Sequence[Sequence[float]] = (),
) -> Figure:
    """Draw the mean of a measure in each cell: a line over one number, a map over two.

    Args:
        panels: laid out by their rows and columns.
        names: of the varied numbers, one or two.
        measure: what is drawn, with its unit.
        title: one line that says what is to be seen.
        share: the measure is a share: from none to all, and written into cells in between.
        note: what a cell is the mean of.
        values: of each number on a grid, where ticks stand; even ticks when left out.
    """
    if not panels or len(names) not in (1, 2):
        raise InputError(
            f"a map of a campaign needs runs and one or two varied numbers, got {len(names)}"
        )
    rows = list(dict.fromkeys(panel.row for panel in panels))
    columns = list(dict.fromkeys(panel.column for panel in panels))
    figure = new_figure(
        title,
        simulated=True,
        height_in=1.1 + (2.5 if len(rows) < 3 else 2.0) * len(rows),
        width_in=max(WIDTH_IN, 0.9 + 2.4 * len(columns)),
    )
    axes = figure.subplots(len(rows), len(columns), sharex=True, sharey=True, squeeze=False)
    for own in axes.flat:
        own.set_visible(False)
    low, high = (0.0, 1.0) if share else _limits(panels)
    drawn: list[tuple[Axes, CampaignPanel]] = []
    for panel in panels:
        at = rows.index(panel.row), columns.index(panel.column)
        own = axes[at]
        own.set_visible(True)
        own.locator_params(nbins=6)
        for axis, grid in zip((own.xaxis, own.yaxis), values, strict=False):
            ticks = ticks_at(grid, 6 if axis is own.xaxis else 9)
            axis.set_ticks(ticks, [f"{value:.4g}" for value in ticks])
        if at[0] == 0:
            own.set_title(panel.column)
        if at[0] == len(rows) - 1:
            own.set_xlabel(names[0])
        drawn.append((own, panel))
    first_column = [own for own, panel in drawn if panel.column == columns[0]]
    for own, row in zip(first_column, rows, strict=False):
        own.set_ylabel((f"{row}\n" if row else "") + (measure if len(names) == 1 else names[1]))
    if len(names) == 1:
        for own, panel in drawn:
            _line(own, panel, share)
    else:
        meshes = [_map(own, panel, low, high, share) for own, panel in drawn]
        figure.colorbar(
            meshes[0],
            ax=list(axes.flat),
            label=measure,
            shrink=1.0 / len(rows) ** 0.7,
            anchor=(0, 1),
        )
    figure.supxlabel(note, fontsize=8.5, x=0.012, ha="left")
    if share and len(names) == 2:
        figure.draw_without_rendering()
        for own, panel in drawn:
            _write_shares(own, panel)
    return figure


def ticks_at(grid: Sequence[float], most: int) -> list[float]:
    """Return the values of a grid, or every second, third ... from the first, so that few stay."""
    step = -(-len(grid) // most)
    even = [each for each in range(step, 2 * step) if (len(grid) - 1) % each == 0]
    return list(grid[:: even[0] if even else step])


def _limits(panels: Sequence[CampaignPanel]) -> tuple[float, float]:
    """Return the least and the greatest mean of all panels."""
    means = np.concatenate([panel.means.ravel() for panel in panels])
    return float(np.nanmin(means)), float(np.nanmax(means))


def _line(axes: Axes, panel: CampaignPanel, share: bool) -> None:
    """Draw the mean over one number, with the range of the runs behind it."""
    middles = 0.5 * (panel.x_edges[1:] + panel.x_edges[:-1])
    known = panel.count[0] > 0.0
    if share:
        axes.set_ylim(-0.05, 1.05)
    else:
        axes.fill_between(
            middles[known], panel.least[0][known], panel.most[0][known], color=PALE, linewidth=0.0
        )
    axes.plot(middles[known], panel.means[0][known], color=BLUE, marker="o", markersize=3.5)


def _map(axes: Axes, panel: CampaignPanel, low: float, high: float, share: bool) -> Any:
    assert panel.y_edges is not None
    axes.grid(visible=False)
    axes.set_facecolor(PALE)  # of cells without a value
    many = panel.count.size > MANY_CELLS
    return axes.pcolormesh(
        panel.x_edges, panel.y_edges, np.ma.masked_invalid(panel.means), vmin=low, vmax=high,
        cmap=SHARES if share else "viridis", rasterized=many,
        edgecolors="none" if many else "white", linewidth=0.4,
    )  # fmt: skip


def _write_shares(axes: Axes, panel: CampaignPanel) -> None:
    """Write shares that are neither none nor all into cells that are large enough."""
    means, y_edges = panel.means, panel.y_edges
    assert y_edges is not None
    box = axes.get_window_extent()
    dpi = axes.figure.dpi
    width, height = (box.width / dpi / means.shape[1], box.height / dpi / means.shape[0])
    if width < LEGIBLE_IN[0] or height < LEGIBLE_IN[1]:
        return
    x = 0.5 * (panel.x_edges[1:] + panel.x_edges[:-1])
    y = 0.5 * (y_edges[1:] + y_edges[:-1])
    for row, column in zip(*np.nonzero((means > 0.0) & (means < 1.0)), strict=True):
        axes.text(
            x[column], y[row], f"{means[row, column]:.2f}".lstrip("0"),
            ha="center", va="center", fontsize=7.0, color=BLACK,
        )  # fmt: skip
