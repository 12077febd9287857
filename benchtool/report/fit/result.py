"""Result of `bt.fit`: numbers of the first method in one step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from benchtool.core.errors import InputError
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


class Params(dict[str, Estimate]):
    """Parameters of a fit by name, fitted ones before derived ones; shown as a table.

    Names are those of the table `estimates`; a unique last part is sufficient (`K_b`).
    """

    def __missing__(self, name: str) -> Estimate:
        return self[resolve_name(name, self)]

    def to_dataframe(self) -> pd.DataFrame:
        """Return a table with a row for each parameter."""
        rows = [
            {"parameter": item.name, "value": item.value, "se": item.se,
             "low_95": item.interval()[0], "high_95": item.interval()[1],
             "unit": item.unit, "remark": item.open or item.bound}
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
        result = self.found.results[0]
        return Params({item.name: item for item in (*result.estimates, *result.derived)})

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

        `z_over_R` is the distance over the rotor radius of the rig, not over `R_m`. The ratio has
        its shape, and is at equal rotor speed or the basis of the fit.
        """
        distances = _distances(z_over_R)
        ratio = fitted_curve(self.found, distances.ravel()).ratio
        return np.asarray(ratio, float).reshape(distances.shape)

    def band(self, z_over_R: Any, level: float = 0.95) -> tuple[Array, Array]:
        """Return the ends of the interval of `predict` at a probability, as in figure `ratio`.

        It is statistical, without the sources of the uncertainty budget outside of the fit.
        """
        distances = _distances(z_over_R)
        if not 0.0 < level < 1.0:
            raise InputError(f"level is {level:g}; give a probability above 0 and below 1")
        for band in fitted_curve(self.found, distances.ravel(), (100.0 * level,)).bands:
            return band.lower.reshape(distances.shape), band.upper.reshape(distances.shape)
        raise InputError("the data do not determine all parameters, so the curve has no band")


def _distances(z_over_R: Any) -> Array:
    distances = np.asarray(z_over_R, float)
    if not np.all(distances > 0.0):
        raise InputError(f"z_over_R is {z_over_R!r:.60}; give numbers above 0")
    return distances


def _units(result: FitResult) -> dict[str, str]:
    return {item.name: item.unit for item in result.estimates}
