"""Comparison page of runs and recordings, with their ranking at a requested thrust."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import cycle
from math import hypot, nan
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchtool.core.channel import error_channel_name
from benchtool.core.choices import Over
from benchtool.core.errors import InputError, UnknownChoice, check_number
from benchtool.core.recording import Recording
from benchtool.core.text import pluralize
from benchtool.data.derived import with_quantities
from benchtool.data.quantities import QUANTITIES, Quantity
from benchtool.report.compare.runs import (
    AXES,
    EFFICIENCIES,
    LOADED,
    SHOWN,
    AtThrust,
    ComparedRun,
    at_thrust,
    ranked,
    read_compared,
)
from benchtool.report.figure import figure, legend_line
from benchtool.report.numbers import value_with_sd
from benchtool.report.page import Block, Heading, Page, Table
from benchtool.report.palette import CYCLE
from benchtool.report.panels import origins_table, panels_height, points, quantity_panels
from benchtool.report.sweep.figures import MARKERS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


THRUST = Quantity(
    name="thrust_N", symbol="T", title="thrust", formula="", of=lambda thrust_N: thrust_N
)
REPEATED = ("efficiency_N_W", "tip_mach", "reynolds_75")  # other units, not drawn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RunComparison:
    """Runs compared over one quantity, and their values at a requested thrust."""

    runs: tuple[ComparedRun, ...]
    over: Over = "thrust"
    thrust_N: float = nan
    found: tuple[AtThrust, ...] = ()  # best first; empty if no thrust is requested
    ranked_by: str = ""

    @property
    def simulated(self) -> bool:
        return any(run.simulated for run in self.runs)

    def tables(self) -> dict[str, Recording]:
        """Return a table per run, with its derived quantities."""
        return {run.name: with_quantities(run.rows, run.quantities) for run in self.runs}


def compare_runs(
    paths: Sequence[Path], over: Over = "thrust", thrust_N: float | None = None
) -> RunComparison:
    """Compare runs and recordings; FileFormatError for a path without thrust."""
    if over not in AXES:
        raise UnknownChoice("axis", over, AXES)
    if not paths:
        raise InputError("no input; give run folders or recordings")
    if thrust_N is not None:
        check_number("the thrust", thrust_N, "N")
    runs = [read_compared(path, over) for path in paths]
    names = [run.name for run in runs]
    runs = [run if names.count(run.name) == 1 else replace(run, name=str(run.path)) for run in runs]
    column, _ = AXES[over]
    if all(run.values(column) is None for run in runs):
        others = [key for key, (name, _) in AXES.items() if any(run.values(name) for run in runs)]
        raise InputError(
            f"{column} is missing in {', '.join(names)}, required for --over {over}; "
            f"use --over {' or '.join(others)}"
        )
    comparison = RunComparison(runs=tuple(runs), over=over)
    if thrust_N is None:
        return comparison
    parked = [
        replace(read_compared(path), name=run.name) if over == "distance" else run
        for path, run in zip(paths, runs, strict=True)
    ]
    by, results = ranked([at_thrust(run, thrust_N) for run in parked])
    return replace(comparison, thrust_N=thrust_N, found=tuple(results), ranked_by=by)


MAX_BARS = 60  # error bars of a run in a panel, limited for legibility; assumed
MAIN = 0.1  # rows above this share of a run's maximum thrust set the axis range; assumed


def _curves_caption(comparison: RunComparison) -> str:
    column = AXES[comparison.over][0]
    names = [run.name for run in comparison.runs if run.values(column) is None]
    return (
        f"Quantities of each run over {comparison.over}: settings of sweeps"
        + (" with the plate parked" if any(run.away for run in comparison.runs) else "")
        + f", levels of recordings; bars: standard errors if known, for up to {MAX_BARS} rows. "
        f"Rows below {100 * LOADED:g} % of a run's maximum thrust are excluded, rows above "
        f"{100 * MAIN:g} % set the axis range."
        + (f" Not drawn, {column} is missing: {', '.join(names)}." if names else "")
    )


def _find_quantities(comparison: RunComparison) -> list[Quantity]:
    """Return the quantities of any run, except the common x axis and other units."""
    column = AXES[comparison.over][0]
    return [
        quantity
        for quantity in (THRUST, *QUANTITIES)
        if quantity.name not in (column, *REPEATED)
        and any(run.values(column) and run.values(quantity.name) for run in comparison.runs)
    ]


@figure(
    title=lambda comparison: f"Runs compared over {comparison.over}",
    caption=_curves_caption,
    when=lambda comparison: bool(_find_quantities(comparison)),
    height_in=lambda comparison: (
        panels_height(_find_quantities(comparison)) + 0.2 * (len(comparison.runs) // 3)
    ),
)
def curves(figure: Figure, comparison: RunComparison) -> None:
    """Draw quantities of several runs over thrust, rpm, power, throttle or distance."""
    column, label = AXES[comparison.over]
    quantities = _find_quantities(comparison)
    runs = list(zip(comparison.runs, cycle(CYCLE), cycle(MARKERS), strict=False))
    for axes, quantity in zip(quantity_panels(figure, quantities, label), quantities, strict=True):
        for run, color, marker in runs:
            x, y = run.values(column), run.values(quantity.name)
            if x is None or y is None:
                continue
            loaded = run.loaded
            if loaded.sum() > MAX_BARS:
                axes.plot(x[0][loaded], y[0][loaded], ".", color=color, ms=2.5, zorder=1.5)
            else:
                points(axes, x[0][loaded], y[0][loaded], y[1][loaded], color, marker, ms=3.4)
        axes.set_xlim(left=0.0 if comparison.over != "throttle" else None)
        _limit(axes, comparison, quantity.name)
    handles = [
        legend_line(ls="", marker=marker, color=color, label=run.name)
        for run, color, marker in runs
    ]
    longest_name = max(len(run.name) for run in comparison.runs)
    figure.legend(handles=handles, loc="outside lower right", ncols=3 if longest_name <= 22 else 2)


def _limit(axes: Axes, comparison: RunComparison, name: str) -> None:
    """Set the y range by the rows above a tenth of each run's maximum thrust."""
    bounds = [np.empty(0)]
    for run in comparison.runs:
        if (pair := run.values(name)) is not None:
            thrust = run.rows.column("thrust_N")
            rows = thrust > MAIN * np.nanmax(thrust)
            value, error = pair[0][rows], np.nan_to_num(pair[1][rows])
            if rows.sum() > MAX_BARS:
                value, error = np.nanpercentile(value, (2, 98)), np.zeros(2)
            bounds += [value - error, value + error]
    values = np.concatenate(bounds)
    values = values[np.isfinite(values)]
    if values.size and (low := float(values.min())) < (high := float(values.max())):
        margin = 0.15 * (high - low)
        bottom, top = axes.get_ylim()
        axes.set_ylim(max(bottom, low - margin), min(top, high + margin))


TITLES = {
    "efficiency_gf_W": "T/P_el [gf/W]", "propeller_gf_W": "T/P_mech [gf/W]",
    "power_W": "P_el [W]", "mechanical_power_W": "P_mech [W]", "rpm1": "rpm",
    "pwm1_us": "pulse [µs]", "figure_of_merit": "FM [–]",
}  # fmt: skip


def best_table(comparison: RunComparison) -> Table | None:
    """Return a table of the runs at the requested thrust, most efficient first."""
    if not comparison.found:
        return None
    known = {key for result in comparison.found for key in result.values}
    columns = [key for key in (*EFFICIENCIES, *SHOWN) if key in known]
    rows, best, by = [], comparison.found[0], comparison.ranked_by
    for rank, result in enumerate(comparison.found, 1):
        values, place, behind = result.values, "–", "–"
        remark = result.remark or "no efficiency: no current channel"
        if by in values:  # then also in those of the best
            place, remark = str(rank), result.remark or "–"
            (first, first_sd), (value, value_sd) = best.values[by], values[by]
            if rank > 1 and (sd := hypot(first_sd, value_sd)) > 0.0:
                behind = f"{(first - value) / sd:.1f}"
        cells = [value_with_sd(*values[key]) if key in values else "–" for key in columns]
        rows.append((place, result.run, *cells, behind, remark))
    return Table(
        f"At {comparison.thrust_N:.4g} N, the most efficient first "
        f"({TITLES[comparison.ranked_by]}): interpolated from rows within a factor 1.5, ± standard "
        f"error. Behind: deficit to the first, in standard deviations of the difference; from 2 on "
        f"it is significant.",
        ("rank", "run", *(TITLES[key] for key in columns), "behind [sd]", "remark"),
        rows,
        text_columns=2,
    )


def short_table(comparison: RunComparison) -> Table | None:
    """Return the table for a terminal."""
    table = best_table(comparison)
    if table is None:
        return None
    power = TITLES[EFFICIENCIES[comparison.ranked_by]]
    heads = ("rank", "run", TITLES[comparison.ranked_by], power, "rpm", "behind [sd]", "remark")
    columns = [table.header.index(head) for head in heads if head in table.header]
    return table.select_columns(columns)


def best_rows(comparison: RunComparison) -> list[dict[str, object]]:
    """Return the values and errors of each run at the requested thrust as rows of a table."""
    return [
        {
            "run": result.run,
            "remark": result.remark,
            **{key: value for key, (value, _) in result.values.items()},
            **{error_channel_name(key): sd for key, (_, sd) in result.values.items()},
        }
        for result in comparison.found
    ]


def comparison_sentence(comparison: RunComparison) -> str:
    """Return a sentence: the best run at the requested thrust, and runs that do not reach it."""
    runs = comparison.runs
    names = f"{pluralize(len(runs), 'run')}: {', '.join(run.name for run in runs)}."
    if not comparison.found:
        return names
    best, result = comparison.found[0], ""
    if comparison.ranked_by in best.values:
        value = value_with_sd(*best.values[comparison.ranked_by])
        rated = [item for item in comparison.found if comparison.ranked_by in item.values]
        rank = "the most efficient" if len(rated) > 1 else "the only one with a value"
        result = f" At {comparison.thrust_N:.4g} N {best.run} is {rank}: {value} gf/W."
    unreached = [f"{item.run} ({item.remark})" for item in comparison.found if not item.values]
    if unreached:
        result += f" Not at that thrust: {', '.join(unreached)}."
        reached_N = min(float(np.nanmax(run.rows.column("thrust_N"))) for run in runs)
        if all(
            np.nanmin(run.rows.column("thrust_N")[run.loaded]) < 0.98 * reached_N for run in runs
        ):
            common = f"{0.99 * reached_N:.3g}"
            result += f" All reach {common} N: --at-thrust {common}."
    return f"{names}{result}"


def _origins(comparison: RunComparison) -> list[Block]:
    runs = [run for run in comparison.runs if run.quantities]
    return [part for run in runs for part in (Heading(run.name), origins_table(run.quantities))]


COMPARISON = Page(
    "compare",
    [
        ("At the wanted thrust", [best_table]),
        ("Curves", ["curves"]),
        ("What quantities are worked out from", [_origins]),
    ],
    title=lambda comparison: f"Runs compared over {comparison.over}",
    summary=comparison_sentence,
)
