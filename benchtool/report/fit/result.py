"""Result of `bt.fit`: numbers of the first method in one step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import stdtridf, stdtrit

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.fit_result import Estimate, FitResult
from benchtool.core.parameter import resolve_name
from benchtool.core.units import Array
from benchtool.data.columns import columns_to_frame, rows_to_frame
from benchtool.fit.run_recipe import FitOutput
from benchtool.physics.model import Model
from benchtool.report.fit.figures import fitted_curve
from benchtool.report.result import Result

if TYPE_CHECKING:
    import pandas as pd

MAX_DOF = 1e6  # Student's t of more degrees of freedom is normal


@dataclass(frozen=True, slots=True)
class Param:
    """Fitted or derived parameter.

    Attributes
    ----------
    name, unit : str
        As in the table `estimates`.
    value : float
        Estimate; median of the draws for emcee.
    se : float
        Standard uncertainty: of the uncertainty budget, or statistical without a budget.
    remark : str
        Reason why the data do not determine the value, or its bound; else empty.
    """

    name: str
    unit: str
    value: float
    se: float
    remark: str
    _ends_95: tuple[float, float] = field(repr=False)

    @classmethod
    def of(cls, item: Estimate) -> Param:
        """Return the parameter of an estimate."""
        has_budget = isfinite(item.combined_sd)
        se = item.combined_sd if has_budget else item.sd
        ends = item.combined_95 if has_budget else item.interval_95
        return cls(item.name, item.unit, item.value, se, item.open or item.bound, ends)

    def interval(self, level: float = 0.95) -> tuple[float, float]:
        """Return lower and upper end of the interval of a probability.

        Other levels than 0.95 scale both sides of the 95 % interval, by Student's t distribution
        of its coverage factor.
        """
        if not 0.0 < level < 1.0:
            raise InputError(f"level is {level:g}; give a probability above 0 and below 1")
        low, high = self._ends_95
        if level == 0.95 or not isfinite(high - low):
            return low, high
        share = _quantile(level, 0.5 * (high - low) / self.se if self.se > 0.0 else 0.0)
        return self.value + share * (low - self.value), self.value + share * (high - self.value)


def _quantile(level: float, factor_95: float) -> float:
    """Return the coverage factor of a level over that of 95 %."""
    normal, most = (float(stdtrit(dof, 0.975)) for dof in (MAX_DOF, 1.0))
    dof = float(stdtridf(0.975, min(factor_95, most))) if factor_95 > normal else MAX_DOF
    return float(stdtrit(dof, 0.5 + 0.5 * level) / stdtrit(dof, 0.975))


class Params(Mapping[str, Param]):
    """Parameters of a fit by name, fitted ones before derived ones; shown as a table.

    Names are those of the table `estimates`; a unique last part is sufficient (`K_b`).
    """

    def __init__(self, result: FitResult) -> None:
        estimates = (*result.estimates, *result.derived)
        self._by_name = {item.name: Param.of(item) for item in estimates}

    def __getitem__(self, name: str) -> Param:
        return self._by_name[resolve_name(name, self._by_name)]

    def get(self, name: str, default: Any = None) -> Any:
        try:
            return self[name]
        except UnknownChoice:
            return default

    def __contains__(self, name: object) -> bool:
        return self.get(str(name)) is not None

    def __iter__(self) -> Iterator[str]:
        return iter(self._by_name)

    def __len__(self) -> int:
        return len(self._by_name)

    def to_dataframe(self) -> pd.DataFrame:
        """Return a table with a row for each parameter."""
        rows = [
            {"parameter": item.name, "value": item.value, "se": item.se,
             "low_95": item.interval()[0], "high_95": item.interval()[1],
             "unit": item.unit, "remark": item.remark}
            for item in self.values()
        ]  # fmt: skip
        return rows_to_frame(rows).set_index("parameter")

    def __repr__(self) -> str:
        return self.to_dataframe().to_string(float_format=lambda number: f"{number:.5g}")

    def _repr_html_(self) -> str:
        return str(self.to_dataframe().to_html(float_format=lambda number: f"{number:.5g}"))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class Fit(Result[FitOutput]):
    """Result of a fit; the numbers are those of its first method.

    Tables: `estimates` (of all methods), `points` and `ratio`.
    """

    @property
    def params(self) -> Params:
        """Parameters by name, with `value`, `se` and `interval(level)`."""
        return Params(self.found.results[0])

    @property
    def covariance(self) -> pd.DataFrame:
        """Statistical covariance of the fitted parameters, in their units."""
        result = self.found.results[0]
        names = [item.name for item in result.estimates]
        columns = dict(zip(names, result.covariance, strict=True))
        return columns_to_frame(columns, _units(result), names)

    @property
    def residuals(self) -> pd.DataFrame:
        """Fitted points: z/R, observed and predicted value, their difference, standard error.

        The index is the row of the table `points`. Values are thrust in N, or ratios.
        """
        data, problem = self.found.data, self.found.problem
        residuals = problem.residuals(self.found.results[0].values)
        columns = {
            "observed": problem.observed,
            "predicted": problem.observed - residuals,
            "residual": residuals,
            "standard_error": problem.standard_error,
        }
        units = dict.fromkeys(columns, "N" if self.found.basis == "joint" else "1")
        columns = {"z_over_R": data.z_over_R[data.rows]} | columns
        return columns_to_frame(columns, {"z_over_R": "1"} | units, data.rows)

    @property
    def samples(self) -> pd.DataFrame:
        """Posterior draws of emcee, a column for each fitted parameter; InputError without.

        Rows are ordered by step, then ensemble, then walker (`attrs["ensembles"]`, `["walkers"]`).
        """
        for result in self.found.results:
            if len(result.samples):
                columns = zip(_units(result), result.samples.T, strict=True)
                table = columns_to_frame(dict(columns), _units(result))
                table.attrs |= {key: result.facts[key] for key in ("ensembles", "walkers")}
                return table
        raise InputError("no posterior draws; fit with method='emcee'")

    @property
    def model(self) -> Model:
        """Model at the fitted values."""
        return self.found.fitted

    def predict(self, z_over_R: Any) -> Array:
        """Return the fitted thrust ratio T_IGE/T_OGE at plate distances, as in figure `ratio`.

        The ratio has the shape of `z_over_R`, and is at equal rotor speed or the basis of the fit.
        """
        distances = np.asarray(z_over_R, float)
        if not np.all(distances > 0.0):
            raise InputError(f"z_over_R is {z_over_R!r:.60}; give numbers above 0")
        ratio = fitted_curve(self.found, distances.ravel()).ratio
        return np.asarray(ratio, float).reshape(distances.shape)


def _units(result: FitResult) -> dict[str, str]:
    return {item.name: item.unit for item in result.estimates}
