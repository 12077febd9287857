"""Uncertainty budget: sources, their contributions to each quantity, combined uncertainty.

Law of propagation, JCGM 100:2008 (GUM), clause 5; effective degrees of freedom and coverage
factor, its annex G; Monte Carlo as a check, JCGM 101:2008.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from math import inf
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.special import stdtr, stdtrit

from benchtool.core.choices import EvaluationType
from benchtool.core.error_source import effective_dof
from benchtool.core.fit_result import Estimate, FitResult
from benchtool.core.units import Array

COVERAGE = 0.95  # probability of the expanded interval
UNIFORM_DRAWS = (np.arange(400.0) + 0.5) / 200.0 - 1.0  # of a source over its half width
MIN_RELATIVE_VALUE = 0.01  # in standard uncertainties; a smaller value is 0, without percent


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetLine:
    """Error source with its contribution to each of n quantities."""

    name: str
    kind: EvaluationType
    unit: str
    sd: float  # standard uncertainty; typical if it differs between points
    distribution: str
    dof: float  # of `sd`; inf if stated
    correlation: str  # points that share one error, as text
    origin: str  # reference or assumption
    in_fit: bool  # True if the fit's intervals contain it
    contribution: tuple[float, ...]  # (n,) standard uncertainty of each quantity, in its unit
    sensitivity: tuple[float, ...]  # (n,) change over that of the source; absolute if independent
    scatter: str = ""  # name of the scatter estimate of `sd` that several lines share


@dataclass(frozen=True, slots=True, kw_only=True)
class MonteCarlo:
    """Result of refits of simulated data, for n quantities in their units."""

    draws: int
    seed: int
    sd: tuple[float, ...]  # (n,) standard deviation of each quantity's error
    low: tuple[float, ...]  # (n,) lower end of its central interval of probability `COVERAGE`
    high: tuple[float, ...]  # (n,) upper end


@dataclass(frozen=True, kw_only=True)
class Budget:
    """Uncertainty of a fit's n quantities by source."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: tuple[float, ...]
    fit_sd: tuple[float, ...]  # standard deviations of the fit
    lines: tuple[BudgetLine, ...]  # independent sources of the combined standard uncertainty
    correlation: tuple[tuple[float, ...], ...]  # (n, n) of the errors, from all sources
    traceability: tuple[str, ...] = ()  # statements on calibrations: device, date, certificate
    monte_carlo: MonteCarlo | None = None

    @cached_property
    def parts(self) -> Array:
        """Contributions (sources, n)."""
        return np.array([line.contribution for line in self.lines], float)

    @cached_property
    def combined(self) -> Array:
        """Combined standard uncertainty (n,)."""
        return np.asarray(np.linalg.norm(self.parts, axis=0), float)

    @cached_property
    def dof(self) -> Array:
        """Effective degrees of freedom (n,)."""
        return np.array([self._dof(column) for column in self.parts.T])

    def _dof(self, parts: Array) -> float:
        dofs = np.array([line.dof for line in self.lines], float)
        return effective_dof(parts, dofs, [line.scatter for line in self.lines])

    @cached_property
    def coverage_factor(self) -> Array:
        """Coverage factor (n,), from Student's t and the largest uniform source."""
        return np.array([self._factor(column) for column in self.parts.T])

    def _factor(self, parts: Array) -> float:
        uniform = parts * [line.distribution == "uniform" for line in self.lines]
        largest, upper = uniform * (uniform == uniform.max()), 0.5 + 0.5 * COVERAGE
        share, dof = largest.max() / np.linalg.norm(parts), self._dof(parts - largest)
        t_width, scale = float(stdtrit(dof, upper)), max(1.0 - share**2, 1e-4) ** 0.5
        half_widths = 3.0**0.5 * share * UNIFORM_DRAWS

        def excess(factor: float) -> float:
            return float(stdtr(dof, (factor - half_widths) / scale).mean()) - upper

        return float(brentq(excess, 0.0, t_width + 2.0)) if share > 0.0 else t_width

    @cached_property
    def expanded(self) -> Array:
        """Expanded uncertainty (n,)."""
        return self.coverage_factor * self.combined

    @cached_property
    def one_percent(self) -> Array:
        """One percent of each value (n,); nan below a hundredth of its standard uncertainty."""
        size = np.abs(self.values)
        return np.where(size > MIN_RELATIVE_VALUE * self.combined, 0.01 * size, np.nan)

    @cached_property
    def percent(self) -> Array:
        """Contributions (sources, n) in percent of the quantity's value; nan for a value of 0."""
        percent: Array = self.parts / self.one_percent
        return percent

    @cached_property
    def confirmed(self) -> tuple[bool, ...]:
        """True if Monte Carlo confirms the expanded interval of a quantity; empty without it.

        Tolerance of both ends: half a unit of the second digit of the standard uncertainty (JCGM
        101, 7.9.2 and 8.1) plus three standard errors of the Monte Carlo quantile of Student's t.
        """
        if self.monte_carlo is None:
            return ()
        ends = np.array([self.monte_carlo.low, self.monte_carlo.high])
        deviation = np.abs(ends - np.array([-self.expanded, self.expanded])).max(axis=0)
        digit = [0.05 * 10.0 ** int(f"{u:.1e}".partition("e")[2]) for u in self.combined]
        below, above = (stdtr(self.dof, self.coverage_factor + step) for step in (-5e-4, 5e-4))
        se = (0.25 * (1.0 - COVERAGE**2) / self.monte_carlo.draws) ** 0.5 * 1e-3 / (above - below)
        return tuple((deviation <= digit + 3.0 * se * self.combined).tolist())

    def add_combined(self, estimate: Estimate, first: bool) -> Estimate:
        """Return an estimate with its combined uncertainty; the budget is of the first method.

        Monte Carlo replaces a propagation that it does not confirm (JCGM 101, 8.1). For another
        method the sources outside of the fit are added in quadrature to each interval side.
        """
        if estimate.name not in self.names:
            return estimate
        index = self.names.index(estimate.name)
        sd, width = float(self.combined[index]), float(self.expanded[index])
        low, high = -width, width
        if self.monte_carlo is not None and not self.confirmed[index]:
            sd, low, high = (getattr(self.monte_carlo, key)[index] for key in _MC_FIELDS)
        if not first:
            outside_sd = np.linalg.norm([u.contribution[index] for u in self.lines if not u.in_fit])
            sd = float(np.hypot(estimate.sd, outside_sd))
            ends = np.array(estimate.interval_95) - estimate.value
            low, high = np.hypot(ends, self.coverage_factor[index] * outside_sd) * (-1.0, 1.0)
        ends_95 = estimate.value + float(low), estimate.value + float(high)
        return replace(estimate, combined_sd=sd, combined_95=ends_95)

    def tables(self) -> dict[str, Any]:
        """Return the budget for JSON, with mappings by quantity name."""
        columns: dict[str, Sequence[Any]] = {
            "unit": self.units,
            "value": self.values,
            "fit_sd": self.fit_sd,
            "combined": self.combined.tolist(),
            "dof": self.dof.tolist(),
            "coverage_factor": self.coverage_factor.tolist(),
            "expanded": self.expanded.tolist(),
        }
        if (monte_carlo := self.monte_carlo) is not None:
            columns |= {f"monte_carlo_{key}": getattr(monte_carlo, key) for key in _MC_FIELDS}
            columns["confirmed"] = self.confirmed
        sources = []
        for line, percent in zip(self.lines, self.percent.tolist(), strict=True):
            row = asdict(line) | {"percent": percent}
            keys = (*_BY_QUANTITY, "percent")
            row |= {key: dict(zip(self.names, row[key], strict=True)) for key in keys}
            sources.append(row)
        return {
            "coverage": COVERAGE,
            "order": self.names,
            "quantities": {
                name: {key: column[index] for key, column in columns.items()}
                for index, name in enumerate(self.names)
            },
            "sources": sources,
            "correlation": self.correlation,
            "traceability": self.traceability,
            "monte_carlo": monte_carlo and {"draws": monte_carlo.draws, "seed": monte_carlo.seed},
        }


def with_budget(results: Sequence[FitResult], budget: Budget | None) -> tuple[FitResult, ...]:
    """Return the results of a fit with the budget's combined uncertainties."""
    if budget is None:
        return tuple(results)
    combined = []
    for result in results:
        estimates, derived = (
            tuple(budget.add_combined(item, result is results[0]) for item in items)
            for items in (result.estimates, result.derived)
        )
        combined.append(replace(result, estimates=estimates, derived=derived))
    return tuple(combined)


_BY_QUANTITY = ("contribution", "sensitivity")
_MC_FIELDS = ("sd", "low", "high")


def parse_budget(tables: Mapping[str, Any]) -> Budget:
    """Return the budget for the JSON form of `Budget.tables`; null means not finite."""
    names, quantities = tuple(tables["order"]), tables["quantities"]

    def column(key: str) -> tuple[Any, ...]:
        return tuple(quantities[name][key] for name in names)

    lines = []
    for source in tables["sources"]:
        row = {f.name: source[f.name] for f in fields(BudgetLine) if f.name in source}
        row |= {key: tuple(source[key][name] for name in names) for key in _BY_QUANTITY}
        lines.append(BudgetLine(**row | {"dof": inf if row["dof"] is None else row["dof"]}))
    mc, mc_fields = tables["monte_carlo"], {key: f"monte_carlo_{key}" for key in _MC_FIELDS}
    return Budget(
        names=names,
        units=column("unit"),
        values=column("value"),
        fit_sd=column("fit_sd"),
        lines=tuple(lines),
        correlation=tuple(tuple(row) for row in tables["correlation"]),
        traceability=tuple(tables["traceability"]),
        monte_carlo=mc and MonteCarlo(**mc | {k: column(key) for k, key in mc_fields.items()}),
    )
