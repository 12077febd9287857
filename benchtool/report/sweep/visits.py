"""Raw samples beside the averages that were made of them, visit by visit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from benchtool.core.units import from_si
from benchtool.report.fit.lengths import refuse_unequal
from benchtool.report.palette import BLACK, BLUE, GREY
from benchtool.report.style import new_figure, styled
from benchtool.report.sweep.sweep import KIND_COLORS

Array = NDArray[np.float64]

WIDTH = 0.7
"""How much of a visit's place its samples take."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Visits:
    """Hold the averaged points of a run in the order of measurement, and their samples.

    Attributes:
        number: (v,) of each visit.
        kind: (v,) what each was for, as in points.csv.
        mean_N, sd_N, se_N: (v,) mean, standard deviation and standard error of the mean.
        sample_number: (n,) visit that each raw sample belongs to.
        sample_N: (n,) raw samples.
    """

    number: Array
    kind: tuple[str, ...]
    mean_N: Array
    sd_N: Array
    se_N: Array
    sample_number: Array
    sample_N: Array

    def __post_init__(self) -> None:
        refuse_unequal(
            "a figure of visits",
            number=self.number,
            mean_N=self.mean_N,
            sd_N=self.sd_N,
            se_N=self.se_N,
        )
        refuse_unequal("its raw samples", sample_number=self.sample_number, sample_N=self.sample_N)


@styled
def visits_figure(visits: Visits, *, title: str, simulated: bool) -> Figure:
    """Draw means over raw samples in the order of measurement; below, samples minus their mean."""
    figure = new_figure(title, simulated=simulated, height_in=5.0)
    top, left = figure.subplots(2, 1, sharex=True)
    place = np.full(visits.sample_N.shape, np.nan)
    away = np.full(visits.sample_N.shape, np.nan)
    for number, mean in zip(visits.number, visits.mean_N, strict=True):
        rows = np.flatnonzero(visits.sample_number == number)
        place[rows] = number + WIDTH * (np.linspace(0.0, 1.0, len(rows)) - 0.5)
        away[rows] = visits.sample_N[rows] - mean
    for axes, values in ((top, visits.sample_N), (left, from_si(away, "mN"))):
        axes.plot(
            place, values, ".", color=GREY, ms=1.6, alpha=0.45, rasterized=True, zorder=1.5,
            label="raw samples",
        )  # fmt: skip
    for kind in dict.fromkeys(visits.kind):
        rows = np.array([item == kind for item in visits.kind])
        color = KIND_COLORS.get(kind, BLACK)
        top.plot(
            visits.number[rows], visits.mean_N[rows], "_", color=color, ms=9.0, mew=2.2, label=kind
        )
    nothing = np.zeros(len(visits.number))
    left.errorbar(
        visits.number, nothing, yerr=from_si(visits.sd_N, "mN"), fmt="none", color=BLACK,
        elinewidth=0.9, capsize=2.5, label="± standard deviation",
    )  # fmt: skip
    left.errorbar(
        visits.number, nothing, yerr=from_si(visits.se_N, "mN"), fmt="none", color=BLUE,
        elinewidth=4.0, capsize=0.0, label="± standard error of the mean",
    )  # fmt: skip
    top.set_ylabel("thrust [N]")
    left.set_ylabel("sample − mean\nof its visit [mN]")
    left.set_xlabel("visit, in the order of measurement")
    figure.align_ylabels([top, left])
    found = dict(zip(*reversed(top.get_legend_handles_labels()), strict=True))
    found |= dict(zip(*reversed(left.get_legend_handles_labels()), strict=True))
    found["raw samples"] = Line2D([], [], color=GREY, marker=".", ls="none", ms=6.0)
    figure.legend(list(found.values()), list(found), loc="outside lower center", ncols=3)
    return figure
