"""Fits of several rigs pooled: which fits, tables, forest plot, page, pool.json."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from math import isnan
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchtool import __version__
from benchtool.core.counted import counted
from benchtool.data.atomic import json_ready, make_folder, replace_json
from benchtool.fit.pool.hierarchy import Difference
from benchtool.report.compare.pooled_fits import PooledFits
from benchtool.report.figure import Page, drawn, figure
from benchtool.report.files import save_figure
from benchtool.report.fit.page import refuse_full
from benchtool.report.html import write_report
from benchtool.report.numbers import numeral, unit_for_people, value_with_sd
from benchtool.report.page import Facts, Paragraph, Table
from benchtool.report.palette import BLUE, GREY, PALE

MOST_PAIRS = 20
"""Differences that a table lists, the surest first; pool.json has all of them."""

BESIDE = 3
"""Panels of the forest plot beside each other."""

LEAST = 1e-6
"""Least probability that is stated: five standard deviations out no fit's errors are normal."""


def _each(one: PooledFits) -> Iterator[tuple[int, str, bool]]:
    """Yield place and name of each parameter, and whether it is shared."""
    yield from zip(range(len(one.units)), one.pooled.names, one.pooled.shared, strict=True)


def _span(low: float, high: float) -> str:
    return f"{numeral(low, '.4g')} to {numeral(high, '.4g')}"


def summary(one: PooledFits) -> str:
    """Say what the rigs share, how far they scatter, and which differ."""
    pooled = one.pooled
    lines = []
    for k, name, shared in _each(one):
        mean = value_with_sd(float(pooled.mean[:, k].mean()), float(pooled.mean[:, k].std()))
        if shared:
            lines.append(f"{name}, the same in all rigs: {mean}.")
            continue
        found = pooled.differences[name]
        real = [each for each in found if each.real]
        low, high = pooled.tau_95(name)
        lines.append(
            f"{name}: mean {mean}, between rigs {np.median(pooled.tau[:, k]):.2g} (95 %: "
            f"{_span(low, high)}); that they do not differ has probability "
            f"{_small(pooled.alike[k])}, even odds before."
        )
        lines.append(
            f"  real differences: {len(real)} of {counted(len(found), 'pair')}"
            + (f"; the surest: {_words(real[0])}" if real else f"; the largest: {_words(found[0])}")
        )
    return "\n".join(lines)


def _small(probability: float) -> str:
    """Return a probability; none as small as no normal approximation can support."""
    return f"{probability:.2g}" if probability > LEAST else f"below {LEAST:g}"


def _words(found: Difference) -> str:
    return (
        f"{found.rig} − {found.other} = {value_with_sd(found.value, found.sd)} (95 %: "
        f"{_span(*found.interval_95)})"
    )


def summary_table(one: PooledFits) -> Table:
    """Return mean and spread of each parameter."""
    pooled, rows = one.pooled, []
    for k, name, shared in _each(one):
        mean = pooled.mean[:, k]
        low, high = np.quantile(mean, [0.025, 0.975])
        rows.append(
            (
                name, unit_for_people(one.units[name]),
                value_with_sd(float(mean.mean()), float(mean.std())), _span(low, high),
                "0 (shared)" if shared else numeral(float(np.median(pooled.tau[:, k])), ".2g"),
                "–" if shared else _span(*pooled.tau_95(name)),
                "–" if shared else _small(pooled.alike[k]),
            )
        )  # fmt: skip
    return Table(
        "Mean of the rigs and standard deviation between them (median; 95 %: shortest interval). "
        "Last: probability that they do not differ at all, even odds before.",
        ("parameter", "unit", "mean", "95 %", "between rigs", "95 %", "alike"),
        rows,
        text_columns=2,
    )


def rigs_table(one: PooledFits) -> Table:
    """Return each rig's values, by itself and pooled."""
    pooled, rows = one.pooled, []
    for k, name, shared in _each(one):
        for place, value, sd in pooled.values_of(name):
            draws = pooled.mean[:, k] if shared else pooled.own[:, place, k]
            rows.append(
                (
                    name, pooled.rigs[place].name, value_with_sd(value, sd),
                    value_with_sd(float(draws.mean()), float(draws.std())),
                    _span(*np.quantile(draws, [0.025, 0.975])),
                )
            )  # fmt: skip
    return Table(
        "Each rig by itself (± combined standard uncertainty of its budget) and pooled.",
        ("parameter", "rig", "by itself", "pooled", "95 %"), rows, text_columns=2,
    )  # fmt: skip


def differences_table(one: PooledFits) -> Table | None:
    """Return the surest differences of each parameter."""
    rows = [
        (name, f"{each.rig} − {each.other}", value_with_sd(each.value, each.sd),
         _span(*each.interval_95), numeral(each.probability, ".4g"), "yes" if each.real else "no")
        for name, found in one.pooled.differences.items()
        for each in found[:MOST_PAIRS]
    ]  # fmt: skip
    if not rows:
        return None
    return Table(
        f"Differences of pooled values, at most {MOST_PAIRS} pairs of each parameter, the surest "
        f"first. Real: the 95 % interval leaves 0 out. Probability: of this sign.",
        ("parameter", "pair", "difference", "95 %", "probability", "real"), rows, text_columns=2,
    )  # fmt: skip


def differences_rows(one: PooledFits) -> list[dict[str, Any]]:
    """Return every difference as rows of columns."""
    return [
        {"parameter": name} | asdict(each) | {"real": each.real}
        for name, found in one.pooled.differences.items()
        for each in found
    ]


def rigs_rows(one: PooledFits) -> list[dict[str, Any]]:
    """Return each rig's values, by itself and pooled, as rows of columns."""
    rows = []
    for k, name, shared in _each(one):
        for place, value, sd in one.pooled.values_of(name):
            draws = one.pooled.mean[:, k] if shared else one.pooled.own[:, place, k]
            low, high = np.quantile(draws, [0.025, 0.975]).tolist()
            rows.append({
                "parameter": name, "rig": one.pooled.rigs[place].name, "unit": one.units[name],
                "value": value, "sd": sd, "pooled": float(draws.mean()),
                "pooled_sd": float(draws.std()), "low_95": low, "high_95": high,
            })  # fmt: skip
    return rows


def tables(one: PooledFits) -> dict[str, Any]:
    """Return the contents of pool.json."""
    pooled = one.pooled
    parameters = {}
    for k, name, shared in _each(one):
        mean, tau = pooled.mean[:, k], pooled.tau[:, k]
        parameters[name] = {
            "unit": one.units[name],
            "shared": shared,
            "mean": float(mean.mean()),
            "mean_sd": float(mean.std()),
            "mean_95": np.quantile(mean, [0.025, 0.975]).tolist(),
            "tau": float(np.median(tau)),
            "tau_95": list(pooled.tau_95(name)),
            "tau_prior_scale": float(pooled.scale[k]),
            "alike": None if isnan(pooled.alike[k]) else float(pooled.alike[k]),
        }
    found: dict[str, Any] = json_ready(
        {
            "format": "benchtool-pool-1", "software": f"benchtool {__version__}", "seed": one.seed,
            "basis": one.basis, "simulated": one.simulated, "data": dict(one.hashes),
            "parameters": parameters, "rigs": rigs_rows(one), "differences": differences_rows(one),
        }
    )  # fmt: skip
    return found


@figure(
    page="compare.pooled",
    name="forest",
    title="Each rig by itself and pooled",
    caption="Open: each fit by itself; filled: partially pooled; bars: 95 %. Band: 95 % of the "
    "common mean.",
    height_in=lambda one: 0.5 + -(-len(one.units) // BESIDE) * (0.8 + 0.36 * len(one.pooled.rigs)),
)
def forest(figure: Figure, one: PooledFits) -> None:
    """Draw every rig's value by itself and pooled, a panel for each parameter."""
    pooled = one.pooled
    rows = len(pooled.rigs)
    beside = min(BESIDE, len(pooled.names))
    down = -(-len(pooled.names) // beside)
    every = figure.subplots(down, beside, sharey=True, squeeze=False).ravel()
    for axes in every[len(pooled.names) :]:
        axes.set_visible(False)
    for axes, (k, name, shared) in zip(every, _each(one), strict=False):
        low, high = np.quantile(pooled.mean[:, k], [0.025, 0.975])
        axes.axvspan(low, high, color=PALE, lw=0.0)
        axes.axvline(float(pooled.mean[:, k].mean()), color=GREY, lw=0.8)
        for place, value, sd in pooled.values_of(name):
            axes.errorbar(value, place - 0.14, xerr=1.96 * sd, fmt="o", color=GREY, mfc="white",
                          ms=4.5, label="by itself")  # fmt: skip
            draws = pooled.mean[:, k] if shared else pooled.own[:, place, k]
            middle = float(draws.mean())
            ends = np.abs(np.quantile(draws, [0.025, 0.975]) - middle)[:, None]
            axes.errorbar(middle, place + 0.14, xerr=ends, fmt="o", color=BLUE, ms=4.5,
                          label="pooled")  # fmt: skip
        unit = unit_for_people(one.units[name])
        axes.set_xlabel(name if unit == "–" else f"{name} [{unit}]")
        axes.set_ylim(rows - 0.5, -0.5)
        axes.set_yticks(range(rows), [rig.name for rig in pooled.rigs])
    handles, labels = every[0].get_legend_handles_labels()
    figure.legend(handles[:2], labels[:2], loc="outside lower right", ncols=2)


PRIOR = (
    "Each rig's value is its fit's, with the covariance of the fit's whole uncertainty budget. The "
    "rigs' true values scatter normally about a common mean with a flat prior. Their standard "
    "deviation tau has the prior s/(s + tau)² (DuMouchel 1994), s² the harmonic mean of the rigs' "
    "own variances: its median is s."
)


def _facts(one: PooledFits) -> Facts:
    scales = {
        f"s of {name}": numeral(float(one.pooled.scale[k]), ".3g")
        for k, name, shared in _each(one)
        if not shared
    }
    return Facts(
        {
            "basis": one.basis,
            **scales,
            "seed": str(one.seed),
            "software": f"benchtool {__version__}",
        }
        | {f"sha256 of {name}": digest for name, digest in one.hashes.items()}
    )


POOL = Page(
    "compare.pooled",
    [
        ("What they share, and whether they differ", [summary_table, "forest"]),
        ("Differences", [differences_table]),
        ("Each rig", [rigs_table]),
        ("What stands behind it", [lambda _: Paragraph(PRIOR), _facts]),
    ],
    title=lambda one: f"{counted(len(one.pooled.rigs), 'fit')} pooled",
    summary=summary,
)


def write_pool(folder: Path, one: PooledFits, commands: Sequence[str] = ()) -> list[Path]:
    """Write page, figure and pool.json into a new folder; return the files.

    Raises:
        WouldOverwrite: the folder holds something already; nothing was written.
    """
    refuse_full(folder)
    make_folder(folder)
    replace_json(folder / "pool.json", tables(one))
    figures = drawn("compare.pooled", one, POOL.figures)
    saved = [path for name, block in figures.items()
             for path in save_figure(block.figure, folder / name)]  # fmt: skip
    page = write_report(folder / "report.html", POOL.report(one, commands, figures))
    return [page, folder / "pool.json", *saved]
