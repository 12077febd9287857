"""Maps of campaigns: one measure over one or two varied numbers, a panel per controller."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchtool.errors import InputError
from benchtool.report.lengths import refuse_unequal
from benchtool.report.palette import BLUE
from benchtool.report.style import new_figure, styled

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class CampaignPanel:
    """Hold the runs of one controller: a measure (m,) at the varied numbers x and y (m,).

    Attributes:
        label: heading of the panel.
        x, y: varied numbers; y None where one number was varied.
        measure: what came out of each run.
    """

    label: str
    x: Array
    y: Array | None
    measure: Array

    def __post_init__(self) -> None:
        refuse_unequal(f"the panel {self.label!r}", x=self.x, y=self.y, measure=self.measure)


@styled
def campaign_figure(
    panels: Sequence[CampaignPanel], names: Sequence[str], measure: str, *, title: str
) -> Figure:
    """Draw the mean of a measure over seeds: a line over one number, a map over two.

    Args:
        panels: one per controller.
        names: of the varied numbers, one or two.
        measure: what is drawn, with its unit.
        title: one line that says what is to be seen.
    """
    if not panels or len(names) not in (1, 2):
        raise InputError(
            f"a map of a campaign needs runs and one or two varied numbers, got {len(names)}"
        )
    figure = new_figure(title, simulated=True, height_in=3.6)
    axes = figure.subplots(1, len(panels), sharex=True, sharey=True, squeeze=False)[0]
    means = [_means(panel) for panel in panels]
    low = min(float(np.nanmin(mean)) for *_, mean in means)
    high = max(float(np.nanmax(mean)) for *_, mean in means)
    for panel, own, (x, y, mean) in zip(panels, axes, means, strict=True):
        own.set_title(panel.label)
        own.set_xlabel(names[0])
        if len(names) == 1:
            own.plot(panel.x, panel.measure, ".", color=BLUE, alpha=0.25, markersize=3.0)
            own.plot(x, mean[0], color=BLUE)
            continue
        drawn = own.pcolormesh(x, y, mean, vmin=low, vmax=high, cmap="viridis", shading="nearest")
        own.grid(visible=False)
    axes[0].set_ylabel(measure if len(names) == 1 else names[1])
    if len(names) == 2:
        figure.colorbar(drawn, ax=list(axes), label=measure)
    return figure


def _means(panel: CampaignPanel) -> tuple[Array, Array, Array]:
    """Return grid x (nx,), grid y (ny,) and the mean measure (ny, nx), nan where there is none.

    Random designs are put into at most twenty bins per number.
    """
    x, columns = _binned(panel.x)
    y, rows = _binned(panel.y if panel.y is not None else np.zeros(panel.x.shape))
    total, count = np.zeros((y.size, x.size)), np.zeros((y.size, x.size))
    known = np.isfinite(panel.measure)
    np.add.at(total, (rows[known], columns[known]), panel.measure[known])
    np.add.at(count, (rows[known], columns[known]), 1.0)
    with np.errstate(invalid="ignore"):
        mean: Array = total / count
    return x, y, mean


def _binned(values: Array, bins: int = 20) -> tuple[Array, NDArray[np.intp]]:
    own, index = np.unique(values, return_inverse=True)
    if own.size <= 4 * bins:
        return own, index
    edges = np.linspace(values.min(), values.max(), bins + 1)
    middles: Array = 0.5 * (edges[1:] + edges[:-1])
    return middles, np.clip(np.searchsorted(edges, values, "right") - 1, 0, bins - 1)
