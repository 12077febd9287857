"""Partial coverage: the share of the full thrust increment against the covered area."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchtool.report.fit.lengths import refuse_unequal
from benchtool.report.palette import BLACK, LOOKS, VERMILION, Role
from benchtool.report.style import new_figure, styled

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class AreaPoints:
    """Hold increments at partial coverage.

    Attributes:
        coverage: (m,) covered share of the disc's area, 0 to 1.
        share: (m,) thrust increment over the increment at full coverage.
        sd: (m,) standard deviation of the share; nan when there is none.
        label: legend entry.
        role: what it is; gives colour and marker.
    """

    coverage: Array
    share: Array
    sd: Array
    label: str
    role: Role = "single_rotor"

    def __post_init__(self) -> None:
        refuse_unequal(
            f"the area series {self.label!r}",
            coverage=self.coverage,
            share=self.share,
            sd=self.sd,
        )


@styled
def area_figure(
    measured: Sequence[AreaPoints],
    factors: AreaPoints | None,
    *,
    title: str,
    simulated: bool,
) -> Figure:
    """Draw measured shares and fitted free area factors over the straight line of the paper.

    Below, the departure from the line, in which a bend of a few per cent can be seen.
    """
    figure = new_figure(title, simulated=simulated, height_in=5.4)
    share, departure = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": [2.2, 1.0]})
    ends = np.array([0.0, 1.0])
    share.plot(
        ends, ends, color=BLACK, linestyle=(0, (5, 2.2)), label="in proportion to the area (line)"
    )
    departure.axhline(0.0, color=BLACK, linestyle=(0, (5, 2.2)), linewidth=1.2)
    for series in measured:
        look = LOOKS[series.role]
        share.errorbar(
            series.coverage, series.share, yerr=series.sd, fmt=look.marker, color=look.color,
            ms=4.6, label=series.label,
        )  # fmt: skip
        departure.errorbar(
            series.coverage, series.share - series.coverage, yerr=series.sd, fmt=look.marker,
            color=look.color, ms=4.6,
        )  # fmt: skip
    if factors is not None:
        order = np.argsort(factors.coverage)
        at, fitted, sd = factors.coverage[order], factors.share[order], factors.sd[order]
        for axes, values, label in (
            (share, fitted, factors.label),
            (departure, fitted - at, None),
        ):
            axes.fill_between(at, values - sd, values + sd, color=VERMILION, alpha=0.2, lw=0.0)
            axes.plot(at, values, "v-", color=VERMILION, ms=5.0, lw=1.3, label=label)
    share.legend(loc="upper left")
    share.set_ylabel("share of the full\nthrust increment [–]")
    departure.set_ylabel("departure from\nthe line [–]")
    departure.set_xlabel("covered share of the rotor disc's area [–]")
    departure.set_xlim(-0.03, 1.03)
    figure.align_ylabels([share, departure])
    return figure
