"""Fits of several rigs pooled: which fits, tables, forest plot, page, pool.json."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from math import isnan
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.special import ndtri

from benchtool import __version__
from benchtool.core.errors import InputError
from benchtool.core.parameter import resolve_name
from benchtool.core.plural import pluralize
from benchtool.data.atomic import json_ready, make_folder, replace_json
from benchtool.data.run.entry import FIT_FILE
from benchtool.fit.pool.hierarchy import Difference, PooledEstimates, RigValues, pool_rigs
from benchtool.physics.catalogue import EFFECTS
from benchtool.report.figure import Page, figure, render_figures
from benchtool.report.files import save_figure
from benchtool.report.fit.page import refuse_full
from benchtool.report.fit.stored_fit import StoredFit, read_stored
from benchtool.report.html import write_report
from benchtool.report.numbers import display_unit, format_number, value_with_sd
from benchtool.report.page import Table
from benchtool.report.palette import BLUE, GREY, PALE

ONE_QUANTITY = 1.0 - 1e-9  # correlation from which two are one quantity: R_m, R_m over radius


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PooledFits:
    """Hold the fits of several rigs and what they say together."""

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
    """Pool the fits of folders, one of each rig; NotConverged where chains of tau disagree."""
    if len(folders) < 2:
        raise InputError(
            f"{pluralize(len(folders), 'fit')} given; pooling needs folders of 2 or more fits, as "
            f"of benchtool fit RUN --model MODEL --out FITS/RUN"
        )
    fits = {name: read_stored(folder) for name, folder in _names(folders).items()}
    hashes = _checked(fits)
    known = list(dict.fromkeys(name for fit in fits.values() for name in _budget(fit).names))
    both = [resolve_name(name, known, "fitted parameter") for name in (*of, *shared)]
    names = list(dict.fromkeys(both)) or [
        name
        for name in known
        if _is_physics(name, fits) and sum(name in _budget(fit).names for fit in fits.values()) > 1
    ]
    if not names:
        raise InputError(
            f"no parameter without a unit is in two of these fits; name some with --of, known: "
            f"{', '.join(known)}"
        )
    rigs = [_values(name, fit, names) for name, fit in fits.items()]
    pooled = pool_rigs(rigs, names, both[len(of) :], seed=seed)
    units = {k: v for fit in fits.values() for k, v in zip(_budget(fit).names, _budget(fit).units,
                                                           strict=True)}  # fmt: skip
    return PooledFits(
        pooled=pooled,
        units={name: units[name] for name in names},
        basis=next(iter(fits.values())).basis,
        simulated=any(fit.simulated for fit in fits.values()),
        seed=seed,
        hashes=hashes,
    )


def _names(folders: Sequence[Path]) -> dict[str, Path]:
    """Return folders by the shortest names that keep them apart."""
    for place, folder in enumerate(folders):
        if not (folder / FIT_FILE).is_file():
            raise InputError(f"{folder} holds no fit; name folders of benchtool fit --out")
        if folder.resolve() in (each.resolve() for each in folders[:place]):
            raise InputError(f"the fit {folder} is named twice; name each once")
    short = [folder.resolve().name for folder in folders]
    return {
        name if short.count(name) == 1 else str(folder): folder
        for name, folder in zip(short, folders, strict=True)
    }


def _budget(fit: StoredFit) -> Any:
    return fit.budget


def _checked(fits: Mapping[str, StoredFit]) -> dict[str, str]:
    """Refuse fits that cannot be pooled; return the hashes of their data."""
    first = next(iter(fits))
    owner: dict[str, str] = {}
    hashes = {}
    for name, fit in fits.items():
        result = fit.results[0]
        problem = ""
        if result.outcome.status != "converged" or fit.budget is None:
            problem = "has no answer"
        elif result.facts.get("verdict") == "rejected":
            problem = "has a model that its data reject, so that its intervals are too narrow"
        elif fit.basis != fits[first].basis:
            problem = f"is of basis {fit.basis}, {first} of {fits[first].basis}"
        for key, digest in result.facts.items():
            if key.startswith("sha256."):
                hashes[f"{name}: {key.removeprefix('sha256.')}"] = str(digest)
                if (other := owner.setdefault(str(digest), name)) != name:
                    problem = f"is of the same data as {other}, which would count twice"
        if problem:
            raise InputError(f"the fit {name} {problem}; fit it anew or leave it out")
    return hashes


def _is_physics(name: str, fits: Mapping[str, StoredFit]) -> bool:
    """Whether a parameter has no unit and describes neither noise nor a sensor nor the plate."""
    effect = EFFECTS.get(name.partition(".")[0])
    if name.startswith("noise.") or (effect and effect.subsystem in ("sensor", "plate")):
        return False
    return any(
        dict(zip(_budget(fit).names, _budget(fit).units, strict=True)).get(name) == "1"
        for fit in fits.values()
    )


def _values(label: str, fit: StoredFit, names: Sequence[str]) -> RigValues:
    """Return a fit's values with the covariance of its whole budget.

    Each standard uncertainty is that of the normal distribution with the same 95 % interval.
    """
    budget, result = _budget(fit), fit.results[0]
    own = tuple(name for name in names if name in budget.names)
    for item in (*result.estimates, *result.derived):
        if item.name in own and (item.bound or item.open):
            raise InputError(
                f"{item.name} of {label} {item.bound or f'is not determined: {item.open}'}; leave "
                f"that fit out, or name other parameters with --of"
            )
    at = [budget.names.index(name) for name in own]
    correlation = np.array(budget.correlation)[np.ix_(at, at)]
    for one, other in combinations(range(len(own)), 2):
        if abs(correlation[one, other]) > ONE_QUANTITY:
            raise InputError(f"{own[one]} and {own[other]} are one quantity; name one of them")
    sd = budget.expanded[at] / float(ndtri(0.975))
    return RigValues(
        name=label,
        names=own,
        values=np.array(budget.values)[at],
        covariance=correlation * np.outer(sd, sd),
    )


BESIDE = 3  # panels of the forest plot beside each other
LEAST = 1e-6  # least probability that is stated: farther out no fit's errors are normal


def _each(one: PooledFits) -> Iterator[tuple[int, str, bool]]:
    """Yield place and name of each parameter, and whether it is shared."""
    yield from zip(range(len(one.units)), one.pooled.names, one.pooled.shared, strict=True)


def _span(low: float, high: float) -> str:
    return f"{format_number(low, '.4g')} to {format_number(high, '.4g')}"


def summary(pooled_fits: PooledFits) -> str:
    """Say what the rigs share, how far they scatter, and which differ."""
    pooled = pooled_fits.pooled
    lines = []
    for k, name, shared in _each(pooled_fits):
        mean = value_with_sd(float(pooled.mean[:, k].mean()), float(pooled.mean[:, k].std()))
        if shared:
            lines.append(f"{name}, the same in all rigs: {mean}.")
            continue
        found = pooled.differences[name]
        real = [each for each in found if each.real]
        low, high = pooled.tau_95(name)
        alike = f"{pooled.alike[k]:.2g}" if pooled.alike[k] > LEAST else f"below {LEAST:g}"
        lines.append(
            f"{name}: mean {mean}, between rigs {np.median(pooled.tau[:, k]):.2g} (95 %: "
            f"{_span(low, high)}); that they do not differ has probability "
            f"{alike}, even odds before."
        )
        lines.append(
            f"  real differences: {len(real)} of {pluralize(len(found), 'pair')}"
            + (f"; the surest: {_words(real[0])}" if real else f"; the largest: {_words(found[0])}")
        )
    return "\n".join(lines)


def _words(found: Difference) -> str:
    return (
        f"{found.rig} − {found.other} = {value_with_sd(found.value, found.sd)} (95 %: "
        f"{_span(*found.interval_95)})"
    )


def rigs_table(pooled_fits: PooledFits) -> Table:
    """Return each rig's values, by itself and pooled."""
    rows = [
        (
            row["parameter"], row["rig"], value_with_sd(row["value"], row["sd"]),
            value_with_sd(row["pooled"], row["pooled_sd"]), _span(row["low_95"], row["high_95"]),
        )
        for row in rigs_rows(pooled_fits)
    ]  # fmt: skip
    return Table(
        "Each rig by itself (± combined standard uncertainty of its budget) and pooled.",
        ("parameter", "rig", "by itself", "pooled", "95 %"), rows, text_columns=2,
    )  # fmt: skip


def differences_rows(pooled_fits: PooledFits) -> list[dict[str, Any]]:
    """Return every difference as rows of columns."""
    return [
        {"parameter": name} | asdict(each) | {"real": each.real}
        for name, found in pooled_fits.pooled.differences.items()
        for each in found
    ]


def rigs_rows(pooled_fits: PooledFits) -> list[dict[str, Any]]:
    """Return each rig's values, by itself and pooled, as rows of columns."""
    rows = []
    for k, name, shared in _each(pooled_fits):
        for place, value, sd in pooled_fits.pooled.values_of(name):
            draws = pooled_fits.pooled.mean[:, k] if shared else pooled_fits.pooled.own[:, place, k]
            low, high = np.quantile(draws, [0.025, 0.975]).tolist()
            rows.append({
                "parameter": name, "rig": pooled_fits.pooled.rigs[place].name, "unit":
                pooled_fits.units[name], "value": value, "sd": sd, "pooled": float(draws.mean()),
                "pooled_sd": float(draws.std()), "low_95": low, "high_95": high,
            })  # fmt: skip
    return rows


def tables(pooled_fits: PooledFits) -> dict[str, Any]:
    """Return the contents of pool.json."""
    pooled = pooled_fits.pooled
    parameters = {}
    for k, name, shared in _each(pooled_fits):
        mean, tau = pooled.mean[:, k], pooled.tau[:, k]
        parameters[name] = {
            "unit": pooled_fits.units[name],
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
            "format": "benchtool-pool-1", "software": f"benchtool {__version__}",
            "seed": pooled_fits.seed, "basis": pooled_fits.basis,
            "simulated": pooled_fits.simulated, "data": dict(pooled_fits.hashes),
            "parameters": parameters, "rigs": rigs_rows(pooled_fits),
            "differences": differences_rows(pooled_fits),
        }
    )  # fmt: skip
    return found


@figure(
    page="compare.pooled",
    title="Each rig by itself and pooled",
    caption="Open: each fit by itself; filled: partially pooled; bars: 95 %. Band: 95 % of the "
    "common mean.",
    height_in=lambda one: 0.5 + -(-len(one.units) // BESIDE) * (0.8 + 0.36 * len(one.pooled.rigs)),
)
def forest(figure: Figure, pooled_fits: PooledFits) -> None:
    """Draw every rig's value by itself and pooled, a panel for each parameter."""
    pooled, table = pooled_fits.pooled, rigs_rows(pooled_fits)
    rigs = [rig.name for rig in pooled.rigs]
    beside = min(BESIDE, len(pooled.names))
    down = -(-len(pooled.names) // beside)
    every = figure.subplots(down, beside, sharey=True, squeeze=False).ravel()
    for axes in every[len(pooled.names) :]:
        axes.set_visible(False)
    for axes, (k, name, _) in zip(every, _each(pooled_fits), strict=False):
        axes.axvspan(*np.quantile(pooled.mean[:, k], [0.025, 0.975]), color=PALE, lw=0.0)
        axes.axvline(float(pooled.mean[:, k].mean()), color=GREY, lw=0.8)
        for row in (row for row in table if row["parameter"] == name):
            place, pool = rigs.index(row["rig"]), row["pooled"]
            ends = [[pool - row["low_95"]], [row["high_95"] - pool]]
            axes.errorbar(row["value"], place - 0.14, xerr=1.96 * row["sd"], fmt="o", color=GREY,
                          mfc="white", ms=4.5, label="by itself")  # fmt: skip
            axes.errorbar(pool, place + 0.14, xerr=ends, fmt="o", color=BLUE, ms=4.5,
                          label="pooled")  # fmt: skip
        unit = display_unit(pooled_fits.units[name])
        axes.set_xlabel(name if unit == "–" else f"{name} [{unit}]")
        axes.set_ylim(len(rigs) - 0.5, -0.5)
        axes.set_yticks(range(len(rigs)), rigs)
    handles, labels = every[0].get_legend_handles_labels()
    figure.legend(handles[:2], labels[:2], loc="outside lower right", ncols=2)


POOL = Page(
    "compare.pooled",
    [("Each rig by itself and pooled", [rigs_table, "forest"])],
    title=lambda one: f"{pluralize(len(one.pooled.rigs), 'fit')} pooled",
    summary=summary,
)


def write_pool(folder: Path, pooled_fits: PooledFits, commands: Sequence[str] = ()) -> list[Path]:
    """Write page, figure and pool.json into a new folder; return the files."""
    refuse_full(folder)
    make_folder(folder)
    replace_json(folder / "pool.json", tables(pooled_fits))
    figures = render_figures("compare.pooled", pooled_fits, POOL.figures)
    saved = [path for name, block in figures.items()
             for path in save_figure(block.figure, folder / name)]  # fmt: skip
    page = write_report(folder / "report.html", POOL.report(pooled_fits, commands, figures))
    return [page, folder / "pool.json", *saved]
