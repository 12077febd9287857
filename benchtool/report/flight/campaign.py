"""Maps of campaigns: one measure over one or two varied numbers, panels side by side."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchtool.core.array import Array
from benchtool.core.errors import InputError
from benchtool.data.run.campaign import campaign_batches
from benchtool.report.figure import Page, figure
from benchtool.report.palette import BLACK, BLUE, PALE, VERMILION
from benchtool.report.panels import ticks_at
from benchtool.report.style import WIDTH_IN
from benchtool.simulate.campaign import Campaign
from benchtool.simulate.design import Design, Vary

MOST_ROWS, MOST_COLUMNS = 6, 5
"""Panels that a figure takes; with more, the mean over the third number is drawn."""

RUNS_PER_CELL = 4.0
"""Random points that a cell of the map should hold on average, so that it has a mean."""

SHARES = LinearSegmentedColormap.from_list("shares", [VERMILION, "#f3ece2", BLUE])
"""None is orange, all is blue: apart under every common colour-vision deficiency."""

MANY_CELLS = 1000
"""Cells of a panel above which a map is an image, even in a vector file, without lines between."""

LEGIBLE_IN = (0.26, 0.13)
"""Width and height of the smallest cell that takes a number, inches."""


class CampaignPanel:
    """Sum up a measure in the cells (ny, nx) of a panel, so that memory holds cells, not runs."""

    def __init__(self, row: str, column: str, shape: tuple[int, int]) -> None:
        self.row, self.column = row, column
        self.count, self.total = np.zeros(shape), np.zeros(shape)
        self.least, self.most = np.full(shape, np.inf), np.full(shape, -np.inf)

    def add(self, at: tuple[NDArray[np.intp], NDArray[np.intp]], values: Array) -> None:
        """Count values (n,) into the cells of these rows and columns (n,)."""
        known = np.isfinite(values)
        cells, values = (at[0][known], at[1][known]), values[known]
        np.add.at(self.count, cells, 1.0)
        np.add.at(self.total, cells, values)
        np.minimum.at(self.least, cells, values)
        np.maximum.at(self.most, cells, values)

    @property
    def means(self) -> Array:
        """Mean of each cell (ny, nx); nan where there is no run with a value."""
        mean: Array = np.full(self.count.shape, np.nan)
        np.divide(self.total, self.count, out=mean, where=self.count > 0.0)
        return mean


@dataclass(frozen=True, slots=True, eq=False)
class CampaignMap:
    """Hold the cells of a campaign: a measure over the first two varied numbers.

    Attributes:
        panels: one per gain set and controller, and per value of a third number if few.
        edges: of the cells along each axis.
    """

    campaign: Campaign
    design: Design
    measure: str
    panels: tuple[CampaignPanel, ...]
    edges: tuple[Array, ...]

    @property
    def rows(self) -> list[str]:
        return list(dict.fromkeys(panel.row for panel in self.panels))

    @property
    def columns(self) -> list[str]:
        return list(dict.fromkeys(panel.column for panel in self.panels))

    @property
    def note(self) -> str:
        """What one cell is the mean of, and at which other numbers."""
        design, campaign = self.design, self.campaign
        shown = 3 if _third(campaign, design) else 2
        over = [
            f"{each.name} from {each.lower:g} to {each.upper:g}" for each in design.varied[shown:]
        ]
        if design.samples:
            over.insert(0, f"the random points in it ({design.samples} in all)")
        over += [f"{design.seeds} seeds"] if design.seeds > 1 else []
        mean = f"mean over {' and '.join(over)}" if over else "one run"
        cell = "point" if len(design.varied) == 1 else "cell"
        if cell == "cell" and not design.samples:
            cell = "cell, drawn around its values"
        fixed = [f"{name} {n}" for name, n in campaign.fixed.items() if name not in design.names]
        return f"Each {cell}: {mean}; {', '.join(fixed)}"


def campaign_map(table: Path, campaign: Campaign, design: Design, measure: str) -> CampaignMap:
    """Return the cells of a campaign's table, read batch by batch.

    The first two varied numbers are the axes; over the others, and the seeds, the mean is taken.

    Raises:
        InputError: the measure has no value in any run.
    """
    axes, third = design.varied[:2], _third(campaign, design)
    edges = tuple(_edges(design, each) for each in axes)
    shape = (len(edges[1]) - 1 if len(axes) == 2 else 1, len(edges[0]) - 1)
    names = [each.name for each in design.varied[: 3 if third else 2]]
    panels: dict[tuple[str, str, int], CampaignPanel] = {}
    for batch in campaign_batches(table, [*names, "gains", "controller", measure]):
        at = [_cell_of(batch[each.name], edge) for each, edge in zip(axes, edges, strict=True)]
        rows = at[1] if len(at) == 2 else np.zeros_like(at[0])
        layer = _cell_of(batch[third.name], third.edges()) if third else np.zeros_like(at[0])
        for gains, controller, number in dict.fromkeys(
            zip(batch["gains"], batch["controller"], layer, strict=True)
        ):
            own = (
                (batch["gains"] == gains) & (batch["controller"] == controller) & (layer == number)
            )
            key = (gains, controller, int(number))
            if key not in panels:
                panels[key] = CampaignPanel(*_labels(campaign, third, *key), shape)
            panels[key].add((rows[own], at[0][own]), np.asarray(batch[measure][own], float))
    if not any(panel.count.any() for panel in panels.values()):
        raise InputError(f"{measure} has no value in any run; draw another measure")
    return CampaignMap(campaign, design, measure, tuple(panels.values()), edges)


def _third(campaign: Campaign, design: Design) -> Vary | None:
    """Return the number that has a panel for each value: the third, where panels stay few."""
    if len(design.varied) < 3 or design.samples:
        return None
    third = design.varied[2]
    several = len(campaign.setups) > 1
    rows = len(campaign.controllers) * (third.count if several else 1)
    columns = 1 if several else third.count
    return third if rows <= MOST_ROWS and columns <= MOST_COLUMNS else None


def _edges(design: Design, varied: Vary) -> Array:
    """Return the cells of one axis: the grid's values, or bins that random points fill."""
    if not design.samples:
        return varied.edges()
    filled = design.samples / RUNS_PER_CELL
    cells = filled if len(design.varied) == 1 else filled**0.5
    return varied.edges(int(np.clip(cells, 2, 20)))


def _cell_of(values: NDArray[np.generic], edges: Array) -> NDArray[np.intp]:
    found = np.searchsorted(edges, np.asarray(values, float), "right") - 1
    return np.clip(found, 0, len(edges) - 2)


def _labels(
    campaign: Campaign, third: Vary | None, gains: str, controller: str, layer: int
) -> tuple[str, str]:
    """Return row and column of a panel: gain sets side by side, or else controllers."""
    value = f"{third.name} = {third.values()[layer]:.4g}" if third else ""
    if len(campaign.setups) > 1:
        several = len(campaign.controllers) > 1
        row = ", ".join(filter(None, (controller if several else "", value)))
        return row, gains if several else f"{gains}, {controller}"
    return (controller, value) if third else ("", controller)


@figure(
    page="flight.campaign",
    name="campaign",
    title="{0.campaign.title}",
    caption="The mean of a measure in each cell: a line over one varied number, a map over two.",
    simulated=True,
    height_in=lambda cells: 1.1 + (2.5 if len(cells.rows) < 3 else 2.0) * len(cells.rows),
    width_in=lambda cells: max(WIDTH_IN, 0.9 + 2.4 * len(cells.columns)),
)
def campaign(figure: Figure, cells: CampaignMap) -> None:
    """Draw the mean of a measure in each cell: a line over one number, a map over two."""
    shown = cells.campaign.measures[cells.measure]
    names, rows, columns = cells.design.names[:2], cells.rows, cells.columns
    values = [] if cells.design.samples else [each.values() for each in cells.design.varied[:2]]
    axes = figure.subplots(len(rows), len(columns), sharex=True, sharey=True, squeeze=False)
    for own in axes.flat:
        own.set_visible(False)
    drawn: list[tuple[Axes, CampaignPanel]] = []
    for panel in cells.panels:
        row, column = rows.index(panel.row), columns.index(panel.column)
        own = axes[row, column]
        own.set_visible(True)
        own.locator_params(nbins=6)
        for axis, grid in zip((own.xaxis, own.yaxis), values, strict=False):
            ticks = ticks_at(grid, 6 if axis is own.xaxis else 9)
            axis.set_ticks(ticks, [f"{value:.4g}" for value in ticks])
        if row == 0:
            own.set_title(panel.column)
        if row == len(rows) - 1:
            own.set_xlabel(names[0])
        drawn.append((own, panel))
    first_column = [own for own, panel in drawn if panel.column == columns[0]]
    for own, name in zip(first_column, rows, strict=False):
        label = shown.text if len(names) == 1 else names[1]
        own.set_ylabel((f"{name}\n" if name else "") + label)
    figure.supxlabel(cells.note, fontsize=8.5, x=0.012, ha="left")
    if len(names) == 1:
        for own, panel in drawn:
            _line(own, panel, cells.edges[0], shown.share)
        return
    means = np.concatenate([panel.means.ravel() for panel in cells.panels])
    limits = (0.0, 1.0) if shown.share else (float(np.nanmin(means)), float(np.nanmax(means)))
    meshes = [_map(own, panel, cells.edges, limits, shown.share) for own, panel in drawn]
    figure.colorbar(
        meshes[0], ax=list(axes.flat), label=shown.text, shrink=1.0 / len(rows) ** 0.7,
        anchor=(0, 1),
    )  # fmt: skip
    if shown.share:
        figure.draw_without_rendering()
        for own, panel in drawn:
            _write_shares(own, panel, cells.edges)


CAMPAIGN = Page("flight.campaign", [("The campaign", ["campaign"])])


def _middles(edges: Array) -> Array:
    return 0.5 * (edges[1:] + edges[:-1])


def _line(axes: Axes, panel: CampaignPanel, edges: Array, share: bool) -> None:
    """Draw the mean over one number, with the range of the runs behind it."""
    known = panel.count[0] > 0.0
    at = _middles(edges)[known]
    if share:
        axes.set_ylim(-0.05, 1.05)
    else:
        least, most = panel.least[0][known], panel.most[0][known]
        axes.fill_between(at, least, most, color=PALE, linewidth=0.0)
    axes.plot(at, panel.means[0][known], color=BLUE, marker="o", markersize=3.5)


def _map(
    axes: Axes,
    panel: CampaignPanel,
    edges: tuple[Array, ...],
    limits: tuple[float, float],
    share: bool,
) -> Any:
    axes.grid(visible=False)
    axes.set_facecolor(PALE)  # of cells without a value
    many = panel.count.size > MANY_CELLS
    return axes.pcolormesh(
        *edges, np.ma.masked_invalid(panel.means), vmin=limits[0], vmax=limits[1],
        cmap=SHARES if share else "viridis", rasterized=many,
        edgecolors="none" if many else "white", linewidth=0.4,
    )  # fmt: skip


def _write_shares(axes: Axes, panel: CampaignPanel, edges: tuple[Array, ...]) -> None:
    """Write shares that are neither none nor all into cells that are large enough."""
    means, box, dpi = panel.means, axes.get_window_extent(), axes.figure.dpi
    width, height = (box.width / dpi / means.shape[1], box.height / dpi / means.shape[0])
    if width < LEGIBLE_IN[0] or height < LEGIBLE_IN[1]:
        return
    x, y = map(_middles, edges)
    for row, column in zip(*np.nonzero((means > 0.0) & (means < 1.0)), strict=True):
        axes.text(
            x[column], y[row], f"{means[row, column]:.2f}".lstrip("0"),
            ha="center", va="center", fontsize=7.0, color=BLACK,
        )  # fmt: skip
