"""Traces of a sampler: every parameter over the steps, four ensembles in four colours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchtool.core.errors import InputError
from benchtool.report.palette import CYCLE, GREY
from benchtool.report.style import new_figure, styled

Array = NDArray[np.float64]

SHOWN_STEPS = 600
"""At most this many steps of a chain are drawn, evenly spaced: more would only blacken the page."""

SHOWN_WALKERS = 12
"""At most this many walkers of each ensemble are drawn."""

R_HAT_LIMIT = 1.01
"""Above it, chains disagree (Vehtari et al., Bayesian Analysis 16, 2021, p. 667)."""


@dataclass(frozen=True, slots=True, eq=False)
class Chains:
    """Hold the traces of independently started ensembles.

    Attributes:
        names: (p,) parameter names with units, as labels.
        draws: (n_ensembles, n_steps, n_walkers, p).
        r_hat, tau_steps: (p,) convergence across ensembles; autocorrelation time in steps.
        discarded_steps: how many steps at the start are left out of the result.
    """

    names: Sequence[str]
    draws: Array
    r_hat: Array
    tau_steps: Array
    discarded_steps: int = 0

    def __post_init__(self) -> None:
        n = len(self.names)
        if self.draws.ndim != 4 or self.draws.shape[3] != n:
            raise InputError(
                f"chains of {n} parameters need draws (ensembles, steps, walkers, {n}), "
                f"got shape {self.draws.shape}"
            )
        if np.shape(self.r_hat) != (n,) or np.shape(self.tau_steps) != (n,):
            raise InputError(
                f"chains of {n} parameters need one r_hat and one tau each, "
                f"got {np.shape(self.r_hat)} and {np.shape(self.tau_steps)}"
            )


@styled
def chain_figure(chains: Chains, *, title: str, simulated: bool) -> Figure:
    """Draw one trace per parameter with R-hat and the autocorrelation time over it."""
    ensembles, steps, walkers, n = chains.draws.shape
    figure = new_figure(title, simulated=simulated, height_in=1.0 + 1.45 * n)
    rows = figure.subplots(n, 1, sharex=True, squeeze=False)[:, 0]
    each_step = max(1, -(-steps // SHOWN_STEPS))
    each_walker = max(1, -(-walkers // SHOWN_WALKERS))
    number = np.arange(0, steps, each_step)
    for index, axes in enumerate(rows):
        for ensemble in range(ensembles):
            lines = axes.plot(
                number,
                chains.draws[ensemble, ::each_step, ::each_walker, index],
                color=CYCLE[ensemble % len(CYCLE)],
                linewidth=0.45,
                alpha=0.5,
                rasterized=True,
            )
            lines[0].set_label(f"ensemble {ensemble + 1}")
        if chains.discarded_steps:
            axes.axvspan(0, chains.discarded_steps, color=GREY, alpha=0.22, linewidth=0.0, zorder=3)
        disagree = "" if chains.r_hat[index] <= R_HAT_LIMIT else f"  (above {R_HAT_LIMIT:g})"
        axes.set_title(
            f"$\\hat{{R}}$ = {chains.r_hat[index]:.4f}{disagree},  "
            f"$\\tau$ = {chains.tau_steps[index]:.0f} steps",
            fontsize=9.0,
        )
        axes.set_ylabel(chains.names[index])
        axes.set_xlim(0, max(steps - 1, 1))
    rows[-1].set_xlabel("step" + (" (grey: left out)" if chains.discarded_steps else ""))
    legend = rows[0].legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=ensembles, fontsize=7.8, frameon=False
    )
    for handle in legend.get_lines():
        handle.set_linewidth(2.0)
        handle.set_alpha(1.0)
    figure.align_ylabels(list(rows))
    return figure
