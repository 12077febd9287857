"""The page that sets runs and recordings side by side, and ranks them at a wanted thrust."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot, nan
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchtool.core.channel import error_channel_name
from benchtool.core.errors import InputError, UnknownChoice, check_number
from benchtool.core.plural import pluralize
from benchtool.core.recording import Recording
from benchtool.data.derived import with_quantities
from benchtool.data.quantities import QUANTITIES, Quantity
from benchtool.report.compare.runs import (
    AXES,
    EFFICIENCIES,
    LOADED,
    SHOWN,
    AtThrust,
    ComparedRun,
    Over,
    at_thrust,
    ranked,
    read_compared,
)
from benchtool.report.figure import Page, figure
from benchtool.report.numbers import value_with_sd
from benchtool.report.page import Block, Heading, Table
from benchtool.report.palette import CYCLE
from benchtool.report.panels import points
from benchtool.report.quantities import origins_table, panels_height, quantity_panels
from benchtool.report.sweep.figures import MARKERS

THRUST = Quantity(
    name="thrust_N", symbol="T", title="thrust", formula="", of=lambda thrust_N: thrust_N
)
REPEATED = ("efficiency_N_W", "tip_mach", "reynolds_75")  # other units, not drawn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RunComparison:
    """Hold runs to be drawn over one quantity, and what each does at a wanted thrust."""

    runs: tuple[ComparedRun, ...]
    over: Over = "thrust"
    thrust_N: float = nan
    found: tuple[AtThrust, ...] = ()  # best first; empty where no thrust is wanted
    ranked_by: str = ""

    @property
    def simulated(self) -> bool:
        return any(run.simulated for run in self.runs)

    def tables(self) -> dict[str, Recording]:
        """Return the rows of every run with its quantities, by name."""
        return {run.name: with_quantities(run.rows, run.quantities) for run in self.runs}


def compare_runs(
    paths: Sequence[Path], over: Over = "thrust", thrust_N: float | None = None
) -> RunComparison:
    """Return runs and recordings side by side; FileFormatError for a path without thrust."""
    if over not in AXES:
        raise UnknownChoice("axis", over, AXES)
    if not paths:
        raise InputError("nothing to compare: name run folders or recordings")
    if thrust_N is not None:
        check_number("the thrust", thrust_N, "N")
    runs = [read_compared(path, over) for path in paths]
    names = [run.name for run in runs]
    runs = [run if names.count(run.name) == 1 else replace(run, name=str(run.path)) for run in runs]
    column, _ = AXES[over]
    if all(run.values(column) is None for run in runs):
        others = [key for key, (name, _) in AXES.items() if any(run.values(name) for run in runs)]
        raise InputError(
            f"none of {', '.join(names)} holds {column}, so they cannot be drawn over {over}; "
            f"choose --over {' or '.join(others)}"
        )
    if thrust_N is None:
        return RunComparison(runs=tuple(runs), over=over)
    parked = [
        replace(read_compared(path), name=run.name) if over == "distance" else run
        for path, run in zip(paths, runs, strict=True)
    ]
    by, found = ranked([at_thrust(run, thrust_N) for run in parked])
    return RunComparison(
        runs=tuple(runs), over=over, thrust_N=thrust_N, found=tuple(found), ranked_by=by
    )


MAX_BARS = 60  # rows of a run with error bars in a panel; more would hide each other; assumed
MAIN = 0.1  # rows above this share of a run's greatest thrust set the range of an axis; assumed


def _left_out(one: RunComparison) -> str:
    column = AXES[one.over][0]
    names = [run.name for run in one.runs if run.values(column) is None]
    idle = (
        f" Rows below {100 * LOADED:g} % of a run's greatest thrust are left out, and those above "
        f"{100 * MAIN:g} % set the range of an axis."
    )
    return idle + (f" Without {column}, and not drawn: {', '.join(names)}." if names else "")


def _drawn(one: RunComparison) -> list[Quantity]:
    """Return what any run has beside the quantity that all are drawn over."""
    column = AXES[one.over][0]
    return [
        quantity
        for quantity in (THRUST, *QUANTITIES)
        if quantity.name not in (column, *REPEATED)
        and any(run.values(column) and run.values(quantity.name) for run in one.runs)
    ]


@figure(
    title=lambda one: f"Runs compared over {one.over}",
    caption=lambda one: (
        f"Every quantity that a run allows over {one.over}, run by run: settings of sweeps"
        + (" with the plate parked" if any(run.away for run in one.runs) else "")
        + f", levels of recordings; bars: standard errors where they are known, of up to "
        f"{MAX_BARS} rows."
        f"{_left_out(one)}"
    ),
    when=lambda one: bool(_drawn(one)),
    height_in=lambda one: panels_height(_drawn(one)) + 0.2 * (len(one.runs) // 3),
)
def curves(figure: Figure, comparison: RunComparison) -> None:
    """Draw every quantity of several runs over thrust, rpm, power, throttle or distance."""
    column, label = AXES[comparison.over]
    quantities = _drawn(comparison)
    for axes, quantity in zip(quantity_panels(figure, quantities, label), quantities, strict=True):
        for place, run in enumerate(comparison.runs):
            x, y = run.values(column), run.values(quantity.name)
            if x is None or y is None:
                continue
            color, marker = CYCLE[place % len(CYCLE)], MARKERS[place % len(MARKERS)]
            loaded = run.loaded
            if loaded.sum() > MAX_BARS:
                axes.plot(x[0][loaded], y[0][loaded], ".", color=color, ms=2.5, zorder=1.5)
            else:
                points(axes, x[0][loaded], y[0][loaded], y[1][loaded], color, marker, ms=3.4)
        axes.set_xlim(left=0.0 if comparison.over != "throttle" else None)
        _limit(axes, comparison, quantity.name)
    handles = [
        Line2D([], [], ls="", marker=MARKERS[place % len(MARKERS)], color=CYCLE[place % len(CYCLE)],
               label=run.name)
        for place, run in enumerate(comparison.runs)
    ]  # fmt: skip
    longest = max(len(run.name) for run in comparison.runs)
    figure.legend(handles=handles, loc="outside lower right", ncols=3 if longest <= 22 else 2)


def _limit(axes: Axes, one: RunComparison, name: str) -> None:
    """Let the rows above a tenth of each run's thrust decide what is seen of an axis."""
    shown = [np.empty(0)]
    for run in one.runs:
        if (pair := run.values(name)) is not None:
            thrust = run.rows.column("thrust_N")
            rows = thrust > MAIN * np.nanmax(thrust)
            value, error = pair[0][rows], np.nan_to_num(pair[1][rows])
            if rows.sum() > MAX_BARS:
                value, error = np.nanpercentile(value, (2, 98)), np.zeros(2)
            shown += [value - error, value + error]
    values = np.concatenate(shown)
    values = values[np.isfinite(values)]
    if values.size and (low := float(values.min())) < (high := float(values.max())):
        room = 0.15 * (high - low)
        bottom, top = axes.get_ylim()
        axes.set_ylim(max(bottom, low - room), min(top, high + room))


TITLES = {
    "efficiency_gf_W": "T/P_el [gf/W]", "propeller_gf_W": "T/P_mech [gf/W]",
    "power_W": "P_el [W]", "mechanical_power_W": "P_mech [W]", "rpm1": "rpm",
    "pwm1_us": "pulse [µs]", "figure_of_merit": "FM [–]",
}  # fmt: skip


def best_table(comparison: RunComparison) -> Table | None:
    """List what each run does at the wanted thrust, the most efficient first."""
    if not comparison.found:
        return None
    shown = [
        key for key in (*EFFICIENCIES, *SHOWN) if any(key in f.values for f in comparison.found)
    ]
    rows = []
    for place, found in enumerate(comparison.found, 1):
        cells = [value_with_sd(*found.values[key]) if key in found.values else "–" for key in shown]
        has_rank = comparison.ranked_by in found.values
        remark = found.remark or ("" if has_rank else "no efficiency: it measures no current")
        rows.append(
            (
                str(place) if has_rank else "–",
                found.run,
                *cells,
                _behind(comparison, found),
                remark or "–",
            )
        )
    return Table(
        f"At {comparison.thrust_N:g} N, the most efficient first "
        f"({TITLES[comparison.ranked_by]}): by a fit "
        f"to the rows within a factor 1.5 of it ± standard errors. Behind: less efficient than the "
        f"first, in standard deviations of the difference.",
        ("rank", "run", *(TITLES[key] for key in shown), "behind [sd]", "remark"),
        rows,
        text_columns=2,
    )


def short_table(comparison: RunComparison) -> Table | None:
    """Return the table in the width of a terminal."""
    table = best_table(comparison)
    if table is None:
        return None
    power = TITLES[EFFICIENCIES[comparison.ranked_by]]
    wanted = ("rank", "run", TITLES[comparison.ranked_by], power, "rpm", "behind [sd]", "remark")
    columns = [table.header.index(head) for head in wanted if head in table.header]
    return table.narrowed(columns)


def _behind(one: RunComparison, found: AtThrust) -> str:
    best, by = one.found[0], one.ranked_by
    if found is best or by not in found.values or by not in best.values:
        return "–"
    (first, first_sd), (own, own_sd) = best.values[by], found.values[by]
    spread = hypot(first_sd, own_sd)
    return f"{(first - own) / spread:.1f}" if spread > 0.0 else "–"


def best_rows(comparison: RunComparison) -> list[dict[str, object]]:
    """Return what each run does at the wanted thrust as rows of columns, errors beside values."""
    rows: list[dict[str, object]] = []
    for found in comparison.found:
        values = {key: value for key, (value, _) in found.values.items()}
        errors = {error_channel_name(key): sd for key, (_, sd) in found.values.items()}
        rows.append({"run": found.run, "remark": found.remark, **values, **errors})
    return rows


def comparison_sentence(comparison: RunComparison) -> str:
    """Say which run is best at the wanted thrust, and which do not reach it."""
    runs = comparison.runs
    names = f"{pluralize(len(runs), 'run')}: {', '.join(run.name for run in runs)}."
    if not comparison.found:
        return names
    best, words = comparison.found[0], ""
    if comparison.ranked_by in best.values:
        value = value_with_sd(*best.values[comparison.ranked_by])
        words = f" At {comparison.thrust_N:g} N {best.run} is the most efficient: {value} gf/W."
    missed = [f"{found.run} ({found.remark})" for found in comparison.found if not found.values]
    return f"{names}{words}" + (f" Not at that thrust: {', '.join(missed)}." if missed else "")


def _origins(one: RunComparison) -> list[Block]:
    blocks: list[Block] = []
    for run in one.runs:
        if run.quantities:
            blocks += [Heading(run.name), origins_table(run.quantities)]
    return blocks


COMPARISON = Page(
    "compare",
    [
        ("At the wanted thrust", [best_table]),
        ("Curves", ["curves"]),
        ("What quantities are worked out from", [_origins]),
    ],
    title=lambda one: f"Runs compared over {one.over}",
    summary=comparison_sentence,
)
