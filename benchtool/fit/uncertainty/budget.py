"""An uncertainty budget: sources, what each contributes to each quantity, and what they make.

Law of propagation, JCGM 100:2008 (GUM), clause 5; effective degrees of freedom and coverage
factor, its annex G; Monte Carlo as the check, JCGM 101:2008.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from math import inf
from typing import Any, Literal

import numpy as np
from scipy.optimize import brentq
from scipy.special import stdtr, stdtrit

from benchtool.core.array_type import Array
from benchtool.core.error_source import effective_dof
from benchtool.core.fit_result import Estimate, FitResult

BudgetMethod = Literal["propagation", "mc"]

COVERAGE = 0.95  # probability of the expanded interval
EVENLY = (np.arange(400.0) + 0.5) / 200.0 - 1.0  # draws of a uniform source over its half width
ZERO = 0.01  # a value below this part of its standard uncertainty is 0 and has no percent


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetLine:
    """State one source and its part in each quantity.

    Attributes:
        sd: standard uncertainty in `unit`; typical where it differs from point to point.
        dof: degrees of freedom of `sd`; inf where it is stated.
        scatter: name of the scatter behind `sd`, where several lines have theirs from it.
        correlation: which points share one draw of it, in words.
        origin: who states or assumes it.
        in_fit: whether the fit's own intervals hold it already.
        contribution: (n,) standard uncertainty that it makes in each quantity, in its unit.
        sensitivity: (n,) change of each quantity over that of the source; without a sign where
            points have draws of their own.
    """

    name: str
    kind: Literal["A", "B"]
    unit: str
    sd: float
    distribution: str
    dof: float
    correlation: str
    origin: str
    in_fit: bool
    contribution: tuple[float, ...]
    sensitivity: tuple[float, ...]
    scatter: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class MonteCarlo:
    """Hold what refits of drawn data found.

    Attributes:
        sd, low, high: (n,) standard deviation of each quantity's error, and ends of its central
            interval of probability `COVERAGE`, in its unit.
    """

    draws: int
    seed: int
    sd: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Budget:
    """Hold the uncertainty of a fit's quantities by source.

    Attributes:
        names, units, values: (n,) of the quantities.
        fit_sd: (n,) standard deviations as the fit states them.
        lines: independent sources; together they make the combined standard uncertainty.
        correlation: (n, n) of the quantities' errors, by all sources together.
        traceability: sentences: who calibrated what, when, with which certificate.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: tuple[float, ...]
    fit_sd: tuple[float, ...]
    lines: tuple[BudgetLine, ...]
    correlation: tuple[tuple[float, ...], ...]
    traceability: tuple[str, ...] = ()
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
        known = np.array([line.dof for line in self.lines], float)
        return effective_dof(parts, known, [line.scatter for line in self.lines])

    @cached_property
    def coverage_factor(self) -> Array:
        """Factor (n,) to expanded uncertainty: of Student's t and the largest uniform source."""
        return np.array([self._factor(column) for column in self.parts.T])

    def _factor(self, parts: Array) -> float:
        uniform = parts * [line.distribution == "uniform" for line in self.lines]
        largest, upper = uniform * (uniform == uniform.max()), 0.5 + 0.5 * COVERAGE
        share, dof = largest.max() / np.linalg.norm(parts), self._dof(parts - largest)
        most, scale = float(stdtrit(dof, upper)), max(1.0 - share**2, 1e-4) ** 0.5
        half_widths = 3.0**0.5 * share * EVENLY

        def excess(factor: float) -> float:
            return float(stdtr(dof, (factor - half_widths) / scale).mean()) - upper

        return float(brentq(excess, 0.0, most + 2.0)) if share > 0.0 else most

    @cached_property
    def expanded(self) -> Array:
        """Expanded uncertainty (n,)."""
        return self.coverage_factor * self.combined

    @cached_property
    def one_percent(self) -> Array:
        """A hundredth of each value (n,); nan for a value of 0 within a hundredth of its error."""
        size = np.abs(self.values)
        return np.where(size > ZERO * self.combined, 0.01 * size, np.nan)

    @cached_property
    def percent(self) -> Array:
        """Contributions (sources, n) in percent of the quantity's value; nan for a value of 0."""
        percent: Array = self.parts / self.one_percent
        return percent

    @cached_property
    def confirmed(self) -> tuple[bool, ...]:
        """Whether Monte Carlo confirms the expanded interval of each quantity; empty without it.

        Both ends within half a unit of the second digit of the standard uncertainty (JCGM 101,
        7.9.2 and 8.1), and three standard errors of the quantile of so many draws of Student's t.
        """
        if self.monte_carlo is None:
            return ()
        ends = np.array([self.monte_carlo.low, self.monte_carlo.high])
        off = np.abs(ends - np.array([-self.expanded, self.expanded])).max(axis=0)
        digit = [0.05 * 10.0 ** int(f"{u:.1e}".partition("e")[2]) for u in self.combined]
        below, above = (stdtr(self.dof, self.coverage_factor + step) for step in (-5e-4, 5e-4))
        se = (0.25 * (1.0 - COVERAGE**2) / self.monte_carlo.draws) ** 0.5 * 1e-3 / (above - below)
        return tuple(bool(one) for one in off <= digit + 3.0 * se * self.combined)

    def added_to(self, item: Estimate, first: bool) -> Estimate:
        """Return an estimate with its combined uncertainty; the budget is of the first method's.

        Monte Carlo goes before a propagation that it does not confirm (JCGM 101, 8.1). Another
        method has the sources outside of the fit in quadrature on each side of its interval.
        """
        if item.name not in self.names:
            return item
        place = self.names.index(item.name)
        sd, width = float(self.combined[place]), float(self.expanded[place])
        low, high = -width, width
        if self.monte_carlo is not None and not self.confirmed[place]:
            sd, low, high = (getattr(self.monte_carlo, key)[place] for key in _DRAWN)
        if not first:
            held = np.linalg.norm([u.contribution[place] for u in self.lines if not u.in_fit])
            sd = float(np.hypot(item.sd, held))
            ends = np.array(item.interval_95) - item.value
            low, high = np.hypot(ends, self.coverage_factor[place] * held) * (-1.0, 1.0)
        ends_95 = item.value + float(low), item.value + float(high)
        return replace(item, combined_sd=sd, combined_95=ends_95)

    def tables(self) -> dict[str, Any]:
        """Return it for JSON; what stands for each quantity is named by it."""
        columns: dict[str, Sequence[Any]] = {
            "unit": self.units,
            "value": self.values,
            "fit_sd": self.fit_sd,
            "combined": self.combined.tolist(),
            "dof": self.dof.tolist(),
            "coverage_factor": self.coverage_factor.tolist(),
            "expanded": self.expanded.tolist(),
        }
        if (drawn := self.monte_carlo) is not None:
            columns |= {f"monte_carlo_{key}": getattr(drawn, key) for key in _DRAWN}
            columns["confirmed"] = self.confirmed
        sources = []
        for line, percent in zip(self.lines, self.percent.tolist(), strict=True):
            own = asdict(line) | {"percent": percent}
            own |= {
                key: dict(zip(self.names, own[key], strict=True)) for key in (*_EACH, "percent")
            }
            sources.append(own)
        return {
            "coverage": COVERAGE,
            "order": self.names,
            "quantities": {
                name: {key: column[place] for key, column in columns.items()}
                for place, name in enumerate(self.names)
            },
            "sources": sources,
            "correlation": self.correlation,
            "traceability": self.traceability,
            "monte_carlo": drawn and {"draws": drawn.draws, "seed": drawn.seed},
        }


def with_budget(results: Sequence[FitResult], budget: Budget | None) -> tuple[FitResult, ...]:
    """Return the results of a fit with the budget's uncertainty beside each statistical one."""
    if budget is None:
        return tuple(results)
    return tuple(
        replace(
            result,
            estimates=tuple(budget.added_to(item, place == 0) for item in result.estimates),
            derived=tuple(budget.added_to(item, place == 0) for item in result.derived),
        )
        for place, result in enumerate(results)
    )


_EACH = ("contribution", "sensitivity")
_DRAWN = ("sd", "low", "high")


def budget_from(tables: Mapping[str, Any]) -> Budget:
    """Return the budget that `Budget.tables` gave, as JSON has it: null for no number."""
    names, quantities = tuple(tables["order"]), tables["quantities"]

    def column(key: str) -> tuple[Any, ...]:
        return tuple(quantities[name][key] for name in names)

    lines = []
    for source in tables["sources"]:
        own = {item.name: source[item.name] for item in fields(BudgetLine) if item.name in source}
        own |= {key: tuple(source[key][name] for name in names) for key in _EACH}
        lines.append(BudgetLine(**own | {"dof": inf if own["dof"] is None else own["dof"]}))
    drawn = tables["monte_carlo"]
    return Budget(
        names=names,
        units=column("unit"),
        values=column("value"),
        fit_sd=column("fit_sd"),
        lines=tuple(lines),
        correlation=tuple(tuple(row) for row in tables["correlation"]),
        traceability=tuple(tables["traceability"]),
        monte_carlo=drawn and MonteCarlo(**drawn | {k: column(f"monte_carlo_{k}") for k in _DRAWN}),
    )
