"""Tables of a fit: values, comparison of methods, laws and models."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import isfinite

from benchtool.core.fit_result import Estimate, FitResult
from benchtool.fit.compare import Comparison
from benchtool.fit.compare_laws import LawComparison, LawScore
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

_HEADLINES = [f"{effect.name}.{effect.headline}" for effect in EFFECTS.values() if effect.headline]
MAIN_PARAMETERS = (  # first rows of a table; a trailing _ marks a prefix
    *(name for name in _HEADLINES if not name.endswith("_")),
    "R_m",
    "k",
    "k_standard_",
    *(name for name in _HEADLINES if name.endswith("_")),
)


def wanted_rank(name: str) -> int:
    """Return the position of a parameter in tables; `len(MAIN_PARAMETERS)` for all others."""
    for rank, beginning in enumerate(MAIN_PARAMETERS):
        if name == beginning or (beginning.endswith("_") and name.startswith(beginning)):
            return rank
    return len(MAIN_PARAMETERS)


METHODS = {"least_squares": "least squares", "emcee": "emcee"}


def estimates_table(result: FitResult) -> Table:
    """Return a table of fitted and derived values; powers of ten are in the unit."""
    return Table(
        f"Fitted values of {result.model}, {METHODS[result.method]}; ± {_kind(result)}.",
        (
            *("parameter", "unit", "value", "standard uncertainty", "95 % interval"),
            *("statistical sd", "68 % statistical", "95 % statistical"),
        ),
        [
            (name, unit, value + _bound(item), *cells)
            for item in (*result.estimates, *result.derived)
            for name, unit, value, *cells in (_estimate_row(item),)
        ],
        text_columns=2,
    )


def _kind(result: FitResult) -> str:
    has_budget = any(isfinite(item.combined_sd) for item in result.estimates)
    of_budget = "one standard uncertainty, of the budget"
    return of_budget if has_budget else "statistical sd, without a budget"


def short_table(result: FitResult) -> Table:
    """Return the table of fitted and derived values for a terminal."""
    rows = []
    for item in (*result.estimates, *result.derived):
        name, unit, value, sd, interval, statistical, *_ = _estimate_row(item)
        value += "" if item.open else f" ± {sd}"
        rows.append((name, unit, value + _bound(item), interval, statistical))
    caption = f"{result.model}, {METHODS[result.method]}; ± {_kind(result)}"
    head = ("parameter", "unit", "value", "95 % interval", "statistical")
    return Table(caption, head, rows, text_columns=2)


def value_cells(result: FitResult, names: Iterable[str]) -> list[str]:
    """Return the printed estimate of each name; "–" if the result lacks it."""
    cells = {item.name: printed(item) for item in (*result.estimates, *result.derived)}
    return [cells.get(name, "–") for name in names]


def fits_table(fits: Mapping[str, Sequence[FitResult]]) -> Table:
    """Return a table of several fits, one column per fit, by its first method."""
    results = [methods[0] for methods in fits.values()]
    units = {item.name: item.unit for result in results
             for item in (*result.estimates, *result.derived)}  # fmt: skip
    names = sorted(units, key=wanted_rank)
    columns = [
        (result.model, *value_cells(result, names), f"{result.chi2_per_dof:.3g}",
         result.outcome.status.replace("_", " "))
        for result in results
    ]  # fmt: skip
    labels = [name_with_unit(name, units[name]) for name in names]
    return Table(
        "Comparison of fits: value ± standard uncertainty; –: fixed or not in the model.",
        ("parameter", *fits),
        list(zip(("model", *labels, "chi²/dof", "outcome"), *columns, strict=True)),
    )


def name_with_unit(name: str, unit: str) -> str:
    """Return a name with its unit in brackets, without brackets if it has none."""
    shown = display_unit(unit)
    return name if shown == "–" else f"{name} [{shown}]"


def printed(item: Estimate, unit: str = "1") -> str:
    """Return a formatted estimate, with its bound if it is at one."""
    if item.open:
        return "not determined"
    return with_statistical(item.value, item.combined_sd, item.sd, unit) + _bound(item)


def _bound(item: Estimate) -> str:
    return f" ({item.bound})" if item.bound else ""


def _estimate_row(item: Estimate) -> tuple[str, ...]:
    if item.open:
        reason = f"not determined: {item.open}"
        return (item.name, display_unit(item.unit), reason, *("–",) * 5)
    has_budget = isfinite(item.combined_sd)
    sd = item.combined_sd if has_budget else item.sd
    ends = item.combined_95 if has_budget else item.interval_95
    exponent = decimal_exponent(item.value, sd)
    digits, statistical_digits = (decimals_for(error / 10.0**exponent) for error in (sd, item.sd))

    def join_scaled(*values: float, decimals: int = statistical_digits) -> str:
        return " … ".join(scaled(value, exponent, decimals) for value in values)

    unit = display_unit(item.unit)
    if exponent:
        unit = power_of_ten(exponent) + ("" if unit == "–" else "\u00a0" + unit)
    return (
        item.name,
        unit,
        join_scaled(item.value, decimals=digits),
        join_scaled(sd, decimals=digits),
        join_scaled(*ends, decimals=digits),
        join_scaled(item.sd),
        join_scaled(*item.interval_68),
        join_scaled(*item.interval_95),
    )


def methods_table(results: Sequence[FitResult]) -> Table:
    """Return a table of the estimates of several methods."""
    names = list(dict.fromkeys(item.name for result in results for item in result.estimates))
    columns = [
        (*value_cells(result, names), f"{result.chi2:.1f} / {result.dof}") for result in results
    ]
    one_model = len({result.model for result in results}) == 1
    heads = [
        ("" if one_model else f"{result.model}, ") + METHODS[result.method] for result in results
    ]
    return Table(
        "Estimates by method.",
        ("parameter", *heads),
        list(zip((*names, "χ² / degrees of freedom"), *columns, strict=True)),
    )


def scored_laws(laws: LawComparison) -> list[LawScore]:
    """Return the laws with a cross-validation score."""
    return [score for score in laws.scores if isfinite(score.behind)]


def laws_table(laws: LawComparison) -> Table:
    """Return a table of ground-effect laws, best first."""
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
        f"Leave-one-out scores of laws on {len(laws.distances)} distances; loss of log score per "
        f"distance, standard errors corrected for overlapping folds (Nadeau and Bengio).",
        (
            *("law", "verdict", "behind", "χ²/dof", "numbers"),
            *("free", "held-out RMS", "equivalent to", "reason"),
        ),
        rows,
        text_columns=2,
    )


def comparison_table(comparison: Comparison) -> Table:
    """Return a table of models, best first."""
    rows = [
        (
            score.model,
            "best" if rank == 0 else "clearly behind" if score.is_clearly_behind else "close",
            *(str(score.parameters), f"{score.chi2_per_dof:.3g}"),
            f"{score.behind_best:.1f} ± {score.behind_best_se:.1f}",
            *(f"{score.held_out_rms:.4g}", f"{score.aic:.1f}", f"{score.bic:.1f}"),
        )
        for rank, score in enumerate(comparison.scores)
    ]
    folds = f" in {comparison.folds} folds over {comparison.settings} settings"
    return Table(
        f"Held-out points{folds if comparison.folds else ''}.",
        (
            *("model", "verdict", "free", "χ²/dof", "log score behind best", "held-out RMS"),
            *("AIC", "BIC"),
        ),
        rows,
        text_columns=2,
    )
