"""From a campaign's table to its map, row by row: memory holds cells, not runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import InputError
from benchtool.simulate.campaign import Campaign
from benchtool.simulate.design import Design, Vary

if TYPE_CHECKING:
    from benchtool.report.files import Figure
    from benchtool.report.flight.campaign import CampaignPanel

Array = NDArray[np.float64]
Key = tuple[str, str, int]

MOST_ROWS, MOST_COLUMNS = 6, 5
"""Panels that a figure takes; with more, the mean over the third number is drawn."""

RUNS_PER_CELL = 4.0
"""Random points that a cell of the map should hold on average, so that it has a mean."""


class _Cells:
    """Sum up one panel: per cell (ny, nx) the runs, their sum, the least and the greatest."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self.count, self.total = np.zeros(shape), np.zeros(shape)
        self.least, self.most = np.full(shape, np.inf), np.full(shape, -np.inf)

    def add(self, at: tuple[NDArray[np.intp], NDArray[np.intp]], values: Array) -> None:
        known = np.isfinite(values)
        cells, values = (at[0][known], at[1][known]), values[known]
        np.add.at(self.count, cells, 1.0)
        np.add.at(self.total, cells, values)
        np.minimum.at(self.least, cells, values)
        np.maximum.at(self.most, cells, values)


def campaign_panels(
    table: Path, campaign: Campaign, design: Design, measure: str
) -> list[CampaignPanel]:
    """Return one panel per gain set and controller, and per value of a third number if few.

    The first two varied numbers are the axes; over the others, and the seeds, the mean is taken.
    """
    from benchtool.data.run.campaign import campaign_batches
    from benchtool.report.flight.campaign import CampaignPanel

    axes, third = design.varied[:2], _third(campaign, design)
    edges = [_edges(design, each) for each in axes]
    shape = (len(edges[1]) - 1 if len(axes) == 2 else 1, len(edges[0]) - 1)
    names = [each.name for each in design.varied[: 3 if third else 2]]
    cells: dict[Key, _Cells] = {}
    for batch in campaign_batches(table, [*names, "gains", "controller", measure]):
        at = [_cell_of(batch[each.name], edge) for each, edge in zip(axes, edges, strict=True)]
        rows = at[1] if len(at) == 2 else np.zeros_like(at[0])
        layer = _cell_of(batch[third.name], third.edges()) if third else np.zeros_like(at[0])
        for key in dict.fromkeys(zip(batch["gains"], batch["controller"], layer, strict=True)):
            own = (batch["gains"] == key[0]) & (batch["controller"] == key[1]) & (layer == key[2])
            summed = cells.setdefault((key[0], key[1], int(key[2])), _Cells(shape))
            summed.add((rows[own], at[0][own]), np.asarray(batch[measure][own], float))
    if not any(summed.count.any() for summed in cells.values()):
        raise InputError(f"{measure} has no value in any run; draw another measure")
    return [
        CampaignPanel(
            row=_labels(campaign, third, key)[0],
            column=_labels(campaign, third, key)[1],
            x_edges=edges[0],
            y_edges=edges[1] if len(axes) == 2 else None,
            count=summed.count,
            total=summed.total,
            least=summed.least,
            most=summed.most,
        )
        for key, summed in cells.items()
    ]


def campaign_map(
    panels: Sequence[CampaignPanel], campaign: Campaign, design: Design, measure: str
) -> Figure:
    """Draw the panels of a campaign: a measure over the first two varied numbers."""
    from benchtool.report.flight.campaign import campaign_figure

    shown = campaign.measures[measure]
    return campaign_figure(
        panels, design.names[:2], shown.text, share=shown.share, title=campaign.title,
        note=_note(campaign, design),
        values=[] if design.samples else [each.values() for each in design.varied[:2]],
    )  # fmt: skip


def _note(campaign: Campaign, design: Design) -> str:
    """Say what one cell is the mean of, and at which other numbers."""
    shown = 3 if _third(campaign, design) else 2
    over = [f"{each.name} from {each.lower:g} to {each.upper:g}" for each in design.varied[shown:]]
    if design.samples:
        over.insert(0, f"the random points in it ({design.samples} in all)")
    over += [f"{design.seeds} seeds"] if design.seeds > 1 else []
    mean = f"mean over {' and '.join(over)}" if over else "one run"
    cell = "point" if len(design.varied) == 1 else "cell"
    if cell == "cell" and not design.samples:
        cell = "cell, drawn around its values"
    fixed = [f"{name} {n}" for name, n in campaign.fixed.items() if name not in design.names]
    return f"Each {cell}: {mean}; {', '.join(fixed)}"


def _third(campaign: Campaign, design: Design) -> Vary | None:
    """Return the number that has a panel for each value: the third, where panels stay few."""
    if len(design.varied) < 3 or design.samples:
        return None
    third = design.varied[2]
    several = len(campaign.gain_sets) > 1
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


def _labels(campaign: Campaign, third: Vary | None, key: Key) -> tuple[str, str]:
    """Return row and column of a panel: gain sets side by side, or else controllers."""
    gains, controller, layer = key
    value = f"{third.name} = {third.values()[layer]:.4g}" if third else ""
    if len(campaign.gain_sets) > 1:
        several = len(campaign.controllers) > 1
        row = ", ".join(filter(None, (controller if several else "", value)))
        return row, gains if several else f"{gains}, {controller}"
    return (controller, value) if third else ("", controller)
