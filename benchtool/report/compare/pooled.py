"""Pooled fits of several rigs: checks, tables, forest plot, page, pool.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import ndtri

from benchtool import __version__
from benchtool.core.errors import InputError
from benchtool.core.parameter import resolve_name
from benchtool.core.text import pluralize
from benchtool.data.atomic import json_ready, make_folder, replace_json
from benchtool.data.run.entry import name_fits
from benchtool.fit.pool import PooledEstimates, RigValues, pool_rigs
from benchtool.fit.result_file import read_fit
from benchtool.fit.run_recipe import FitSummary
from benchtool.physics.catalogue import EFFECTS
from benchtool.report.figure import figure
from benchtool.report.fit.page import refuse_full
from benchtool.report.fit.tables import name_with_unit
from benchtool.report.numbers import format_number, value_with_sd
from benchtool.report.page import Page, Table
from benchtool.report.palette import BLUE, GREY, PALE

if TYPE_CHECKING:
    from matplotlib.figure import Figure


ONE_QUANTITY = 1.0 - 1e-9  # correlation of two names of one quantity: R_m, R_m over radius


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PooledFits:
    """Pooled estimates of several rigs, with their inputs."""

    pooled: PooledEstimates
    units: Mapping[str, str]  # of parameters
    basis: str
    simulated: bool
    seed: int
    hashes: Mapping[str, str]  # of data files, by fit and file


def pool_fits(
    folders: Sequence[Path],
    of: Sequence[str] = (),  # parameters; default: those of the physics without unit
    shared: Sequence[str] = (),
    *,
    seed: int = 1,
) -> PooledFits:
    """Pool one fit per rig; NotConverged if the chains of tau disagree."""
    fits = {name: read_fit(folder) for name, folder in name_fits(folders).items()}
    hashes = _check_fits(fits)
    units = {k: v for fit in fits.values() for k, v in _units(fit).items()}
    requested = [resolve_name(name, units, "fitted parameter") for name in (*of, *shared)]
    names = list(dict.fromkeys(requested)) or [
        name
        for name, unit in units.items()
        if unit == "1" and _is_physics(name) and sum(name in _units(f) for f in fits.values()) > 1
    ]
    if not names:
        raise InputError(
            f"no dimensionless parameter is in two of these fits; select some with --of: "
            f"{', '.join(units)}"
        )
    rigs = [_values(name, fit, names) for name, fit in fits.items()]
    return PooledFits(
        pooled=pool_rigs(rigs, names, requested[len(of) :], seed=seed),
        units={name: units[name] for name in names},
        basis=next(iter(fits.values())).basis,
        simulated=any(fit.simulated for fit in fits.values()),
        seed=seed,
        hashes=hashes,
    )


def _units(fit: FitSummary) -> dict[str, str]:
    """Return the units of a fit's quantities by name."""
    assert fit.budget is not None  # _check_fits
    return dict(zip(fit.budget.names, fit.budget.units, strict=True))


def _check_fits(fits: Mapping[str, FitSummary]) -> dict[str, str]:
    """Raise if fits cannot be pooled; return the hashes of their data."""
    first = next(iter(fits))
    owner: dict[str, str] = {}
    hashes = {}
    for name, fit in fits.items():
        result = fit.results[0]
        problem = ""
        if result.outcome.status != "converged" or fit.budget is None:
            problem = "has not converged or has no budget"
        elif result.facts.get("verdict") == "rejected":
            problem = "has a rejected model, so its intervals are too narrow"
        elif fit.basis != fits[first].basis:
            problem = f"has basis {fit.basis}, {first} has {fits[first].basis}"
        for key, digest in result.facts.items():
            if key.startswith("sha256."):
                hashes[f"{name}: {key.removeprefix('sha256.')}"] = str(digest)
                if (other := owner.setdefault(str(digest), name)) != name:
                    problem = f"has the same data as {other}, which would count twice"
        if problem:
            raise InputError(f"fit {name} {problem}; repeat the fit or remove it")
    return hashes


def _is_physics(name: str) -> bool:
    """Return False for parameters of noise, sensors and the plate."""
    effect = EFFECTS.get(name.partition(".")[0])
    is_bench = effect is not None and effect.subsystem in ("sensor", "plate")
    return not name.startswith("noise.") and not is_bench


def _values(label: str, fit: FitSummary, names: Sequence[str]) -> RigValues:
    """Return the values of a fit with the covariance of its whole budget.

    Each standard uncertainty is that of the normal distribution with the same 95 % interval.
    """
    budget, result = fit.budget, fit.results[0]
    assert budget is not None  # _check_fits
    fitted = tuple(name for name in names if name in budget.names)
    for item in (*result.estimates, *result.derived):
        if item.name in fitted and (item.bound or item.open):
            raise InputError(
                f"{item.name} of {label} {item.bound or f'is not determined: {item.open}'}; remove "
                f"that fit or select other parameters with --of"
            )
    indices = [budget.names.index(name) for name in fitted]
    correlation = np.array(budget.correlation)[np.ix_(indices, indices)]
    for first, second in combinations(range(len(fitted)), 2):
        if abs(correlation[first, second]) > ONE_QUANTITY:
            raise InputError(
                f"{fitted[first]} and {fitted[second]} are the same quantity; select one"
            )
    sd = budget.expanded[indices] / float(ndtri(0.975))
    return RigValues(
        name=label,
        names=fitted,
        values=np.array(budget.values)[indices],
        covariance=correlation * np.outer(sd, sd),
    )


MAX_COLUMNS = 3  # panels per row of the forest plot
MIN_PROBABILITY = 1e-6  # smallest reported; errors are not normal in the far tails


def _span(low: float, high: float) -> str:
    return f"{format_number(low, '.4g')} to {format_number(high, '.4g')}"


def summary(pooled_fits: PooledFits) -> str:
    """Return lines on means, spread between rigs, and differences."""
    pooled = pooled_fits.pooled
    lines = []
    for k, name in enumerate(pooled.names):
        mean = value_with_sd(float(pooled.mean[:, k].mean()), float(pooled.mean[:, k].std()))
        if pooled.shared[k]:
            lines.append(f"{name}, common to all rigs: {mean}.")
            continue
        pairs = pooled.differences[name]
        real = [pair for pair in pairs if pair.is_significant]
        low, high = pooled.tau_95(name)
        probability = pooled.identical_probability[k]
        alike = f"{probability:.2g}" if probability > MIN_PROBABILITY else f"< {MIN_PROBABILITY:g}"
        lines.append(
            f"{name}: mean {mean}, standard deviation between rigs "
            f"{np.median(pooled.tau[:, k]):.2g} (95 %: {_span(low, high)}); posterior probability "
            f"of identical rigs {alike}, prior 0.5."
        )
        label, pair = ("most significant", real[0]) if real else ("largest", pairs[0])
        lines.append(
            f"  significant differences: {len(real)} of {pluralize(len(pairs), 'pair')}; {label}: "
            f"{pair.rig} − {pair.other} = {value_with_sd(pair.value, pair.sd)} (95 %: "
            f"{_span(*pair.interval_95)})"
        )
    return "\n".join(lines)


def rigs_table(pooled_fits: PooledFits) -> Table:
    """Return a table of each rig's values, separate and pooled."""
    rows = [
        (
            row["parameter"], row["rig"], value_with_sd(row["value"], row["sd"]),
            value_with_sd(row["pooled"], row["pooled_sd"]), _span(row["low_95"], row["high_95"]),
        )
        for row in rigs_rows(pooled_fits)
    ]  # fmt: skip
    return Table(
        "Values of each rig, separate (± combined standard uncertainty) and pooled.",
        ("parameter", "rig", "separate", "pooled", "95 %"), rows, text_columns=2,
    )  # fmt: skip


def differences_rows(pooled_fits: PooledFits) -> list[dict[str, Any]]:
    """Return all differences as rows of a table."""
    return [
        {"parameter": name} | asdict(pair) | {"real": pair.is_significant}
        for name, pairs in pooled_fits.pooled.differences.items()
        for pair in pairs
    ]


def rigs_rows(pooled_fits: PooledFits) -> list[dict[str, Any]]:
    """Return each rig's values, separate and pooled, as rows of a table."""
    rows, pooled = [], pooled_fits.pooled
    for k, name in enumerate(pooled.names):
        for rig_index, value, sd in pooled.find_values(name):
            is_shared = pooled.shared[k]
            draws = pooled.mean[:, k] if is_shared else pooled.rig_values[:, rig_index, k]
            low, high = np.quantile(draws, [0.025, 0.975]).tolist()
            rows.append({
                "parameter": name, "rig": pooled.rigs[rig_index].name,
                "unit": pooled_fits.units[name], "value": value, "sd": sd,
                "pooled": float(draws.mean()), "pooled_sd": float(draws.std()),
                "low_95": low, "high_95": high,
            })  # fmt: skip
    return rows


def tables(pooled_fits: PooledFits) -> dict[str, Any]:
    """Return the contents of pool.json."""
    pooled = pooled_fits.pooled
    parameters = {}
    for k, name in enumerate(pooled.names):
        mean, tau, alike = pooled.mean[:, k], pooled.tau[:, k], pooled.identical_probability[k]
        parameters[name] = {
            "unit": pooled_fits.units[name],
            "shared": pooled.shared[k],
            "mean": float(mean.mean()),
            "mean_sd": float(mean.std()),
            "mean_95": np.quantile(mean, [0.025, 0.975]).tolist(),
            "tau": float(np.median(tau)),
            "tau_95": list(pooled.tau_95(name)),
            "tau_prior_scale": float(pooled.scale[k]),
            "alike": float(alike),  # null if shared
        }
    contents = {
        "format": "benchtool-pool-1", "software": f"benchtool {__version__}",
        "seed": pooled_fits.seed, "basis": pooled_fits.basis,
        "simulated": pooled_fits.simulated, "data": dict(pooled_fits.hashes),
        "parameters": parameters, "rigs": rigs_rows(pooled_fits),
        "differences": differences_rows(pooled_fits),
    }  # fmt: skip
    return dict(json_ready(contents))


@figure(
    page="compare.pooled",
    title="Each rig separate and pooled",
    caption="Open: separate fit; filled: partially pooled; bars: 95 %. Band: 95 % interval of the "
    "common mean.",
    height_in=lambda fits: (
        0.5 + ceil(len(fits.units) / MAX_COLUMNS) * (0.8 + 0.36 * len(fits.pooled.rigs))
    ),
)
def forest(figure: Figure, pooled_fits: PooledFits) -> None:
    """Draw each rig's value, separate and pooled, in one panel per parameter."""
    pooled, table = pooled_fits.pooled, rigs_rows(pooled_fits)
    rigs = [rig.name for rig in pooled.rigs]
    n_columns = min(MAX_COLUMNS, len(pooled.names))
    n_rows = ceil(len(pooled.names) / n_columns)
    panels = figure.subplots(n_rows, n_columns, sharey=True, squeeze=False).ravel()
    for axes in panels[len(pooled.names) :]:
        axes.set_visible(False)
    for axes, (k, name) in zip(panels, enumerate(pooled.names), strict=False):
        axes.axvspan(*np.quantile(pooled.mean[:, k], [0.025, 0.975]), color=PALE, lw=0.0)
        axes.axvline(float(pooled.mean[:, k].mean()), color=GREY, lw=0.8)
        for row in (row for row in table if row["parameter"] == name):
            position, pooled_value = rigs.index(row["rig"]), row["pooled"]
            ends = [[pooled_value - row["low_95"]], [row["high_95"] - pooled_value]]
            axes.errorbar(row["value"], position - 0.14, xerr=1.96 * row["sd"], fmt="o", color=GREY,
                          mfc="white", ms=4.5, label="separate")  # fmt: skip
            axes.errorbar(pooled_value, position + 0.14, xerr=ends, fmt="o", color=BLUE, ms=4.5,
                          label="pooled")  # fmt: skip
        axes.set_xlabel(name_with_unit(name, pooled_fits.units[name]))
        axes.set_ylim(len(rigs) - 0.5, -0.5)
        axes.set_yticks(range(len(rigs)), rigs)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles[:2], labels[:2], loc="outside lower right", ncols=2)


POOL = Page(
    "compare.pooled",
    [("Each rig separate and pooled", [rigs_table, "forest"])],
    title=lambda pooled_fits: f"{pluralize(len(pooled_fits.pooled.rigs), 'fit')} pooled",
    summary=summary,
)


def write_pool(folder: Path, pooled_fits: PooledFits, commands: Sequence[str] = ()) -> list[Path]:
    """Write page, figure and pool.json into a new folder; return the files."""
    refuse_full(folder)
    make_folder(folder)
    replace_json(folder / "pool.json", tables(pooled_fits))
    page, *figures = POOL.write(folder, pooled_fits, commands)
    return [page, folder / "pool.json", *figures]
