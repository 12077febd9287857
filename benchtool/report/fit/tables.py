"""Tables of a fit for the report page: values, methods side by side, models compared."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite

from benchtool.core.fit_result import Estimate, FitResult
from benchtool.fit.compare import Comparison
from benchtool.fit.law_scores import LawComparison, LawScore
from benchtool.physics.catalogue import EFFECTS
from benchtool.report.numbers import (
    decimal_exponent,
    decimals_for,
    display_unit,
    power_of_ten,
    scaled,
    with_statistical,
)
from benchtool.report.page import Table

_HEADLINES = [f"{one.name}.{one.headline}" for one in EFFECTS.values() if one.headline]
MOST_WANTED = (  # first parameters of a table, by the begin of their names
    *(name for name in _HEADLINES if not name.endswith("_")),
    "R_m",
    "k",
    "k_standard_",
    *(name for name in _HEADLINES if name.endswith("_")),
)


def wanted_rank(name: str) -> int:
    """Return how soon a reader looks for a parameter: 0 first, `len(MOST_WANTED)` for the rest."""
    for place, beginning in enumerate(MOST_WANTED):
        if name == beginning or (beginning.endswith("_") and name.startswith(beginning)):
            return place
    return len(MOST_WANTED)


METHODS = {"least_squares": "least squares", "emcee": "emcee"}


def estimates_table(result: FitResult) -> Table:
    """List every fitted and derived value with its errors; powers of ten are in the unit."""
    return Table(
        f"Fitted values of {result.model}, {METHODS[result.method]}; ± {_kind(result)}.",
        (
            *("parameter", "unit", "value", "standard uncertainty", "95 % interval"),
            *("statistical sd", "68 % statistical", "95 % statistical"),
        ),
        [
            (name, unit, value + _bound(item), *rest)
            for item in (*result.estimates, *result.derived)
            for name, unit, value, *rest in (_estimate_row(item),)
        ],
        text_columns=2,
    )


def _kind(result: FitResult) -> str:
    has_budget = any(isfinite(item.combined_sd) for item in result.estimates)
    return "uncertainty of the budget" if has_budget else "statistical sd, without a budget"


def short_table(result: FitResult) -> Table:
    """List every fitted and derived value in the width of a terminal."""
    rows = []
    for item in (*result.estimates, *result.derived):
        name, unit, value, sd, interval, statistical, *_ = _estimate_row(item)
        value += "" if item.open else f" ± {sd}"
        rows.append((name, unit, value + _bound(item), interval, statistical))
    return Table(
        f"{result.model}, {METHODS[result.method]}; ± {_kind(result)}",
        ("parameter", "unit", "value", "95 % interval", "statistical"),
        rows,
        text_columns=2,
    )


def fits_table(fits: Mapping[str, Sequence[FitResult]]) -> Table:
    """List the values of several fits side by side, one fit a column, by its first method."""
    first = {name: results[0] for name, results in fits.items()}
    known = {
        item.name: item.unit for one in first.values() for item in (*one.estimates, *one.derived)
    }
    rows = [("model", *(one.model for one in first.values()))]
    for name in sorted(known, key=wanted_rank):
        cells = []
        for one in first.values():
            found = {item.name: item for item in (*one.estimates, *one.derived)}
            cells.append(printed(found[name]) if name in found else "–")
        unit = display_unit(known[name])
        rows.append((name if unit == "–" else f"{name} [{unit}]", *cells))
    rows.append(("chi²/dof", *(f"{one.chi2_per_dof:.3g}" for one in first.values())))
    rows.append(("outcome", *(one.outcome.status.replace("_", " ") for one in first.values())))
    return Table(
        "Fits side by side: value ± standard uncertainty; – where a fit holds or lacks it.",
        ("parameter", *first), rows,
    )  # fmt: skip


def printed(item: Estimate, unit: str = "1") -> str:
    """Return an estimate as people read it, with the bound that it ended at."""
    if item.open:
        return "not determined"
    return with_statistical(item.value, item.combined_sd, item.sd, unit) + _bound(item)


def _bound(item: Estimate) -> str:
    return f" ({item.bound})" if item.bound else ""


def _estimate_row(item: Estimate) -> tuple[str, ...]:
    if item.open:
        why = f"not determined: {item.open}"
        return (item.name, display_unit(item.unit), why, *("–",) * 5)
    has_budget = isfinite(item.combined_sd)
    sd = item.combined_sd if has_budget else item.sd
    ends = item.combined_95 if has_budget else item.interval_95
    exponent = decimal_exponent(item.value, sd)
    digits, own_digits = (decimals_for(each / 10.0**exponent) for each in (sd, item.sd))

    def shown(*values: float, decimals: int = own_digits) -> str:
        return " … ".join(scaled(value, exponent, decimals) for value in values)

    unit = display_unit(item.unit)
    if exponent:
        unit = power_of_ten(exponent) + ("" if unit == "–" else "\u00a0" + unit)
    return (
        item.name,
        unit,
        shown(item.value, decimals=digits),
        shown(sd, decimals=digits),
        shown(*ends, decimals=digits),
        shown(item.sd),
        shown(*item.interval_68),
        shown(*item.interval_95),
    )


def methods_table(results: Sequence[FitResult]) -> Table:
    """Set the answers of several methods side by side."""
    names = dict.fromkeys(item.name for result in results for item in result.estimates)
    rows = []
    for name in names:
        cells = [name]
        for result in results:
            found = next((item for item in result.estimates if item.name == name), None)
            cells.append(printed(found) if found else "–")
        rows.append(cells)
    rows.append(
        ["χ² / degrees of freedom", *(f"{result.chi2:.1f} / {result.dof}" for result in results)]
    )
    one_model = len({result.model for result in results}) == 1
    heads = [
        ("" if one_model else f"{result.model}, ") + METHODS[result.method] for result in results
    ]
    return Table("The same problem by each method.", ("parameter", *heads), rows)


def scored_laws(laws: LawComparison) -> list[LawScore]:
    """Return the laws that have a score at held-out distances."""
    return [score for score in laws.scores if isfinite(score.behind)]


def laws_table(laws: LawComparison) -> Table:
    """Return the laws of thrust against distance side by side, the best first."""
    rows = [
        (
            score.law,
            score.verdict,
            f"{score.behind:.2f} ± {score.behind_se:.2f}" if isfinite(score.behind) else "–",
            f"{score.chi2_per_dof:.3g}" if isfinite(score.chi2_per_dof) else "–",
            score.values or score.reason,
            str(score.parameters or "–"),
            f"{score.held_out_rms:.4g}" if isfinite(score.held_out_rms) else "–",
            ", ".join(score.one_with) or "–",
            score.reason or "–",
        )
        for score in laws.scores
    ]
    return Table(
        f"Laws on {len(laws.distances)} distances, each held out once; loss of log score per "
        f"distance, standard errors corrected for overlapping folds (Nadeau and Bengio).",
        (
            *("law", "verdict", "behind", "χ²/dof", "numbers"),
            *("free", "held-out RMS", "one law with", "why"),
        ),
        rows,
        text_columns=2,
    )


def comparison_table(comparison: Comparison) -> Table:
    """Return the models side by side, the best first."""
    rows = [
        (
            score.model,
            "best" if place == 0 else "clearly behind" if score.clearly_behind else "close",
            str(score.parameters),
            f"{score.chi2_per_dof:.3g}",
            f"{score.behind_best:.1f} ± {score.behind_best_se:.1f}",
            f"{score.held_out_rms:.4g}",
            f"{score.aic:.1f}",
            f"{score.bic:.1f}",
        )
        for place, score in enumerate(comparison.scores)
    ]
    held_out = f" in {comparison.folds} folds over {comparison.settings} settings"
    return Table(
        f"Held-out points{held_out if comparison.folds else ''}.",
        (
            *("model", "verdict", "free", "χ²/dof", "log score behind best", "held-out RMS"),
            *("AIC", "BIC"),
        ),
        rows,
        text_columns=2,
    )
