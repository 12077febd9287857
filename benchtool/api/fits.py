"""Fits of ground-effect models, for one rig and for several."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from benchtool.api.messages import keyword_messages, keyword_names
from benchtool.core.errors import DataWarning, InputError, UnknownChoice
from benchtool.core.inputs import build_inputs, items
from benchtool.core.keywords import with_keywords
from benchtool.core.text import read_texts
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.fit.recipe import TableFitInputs, TableInputs, base_recipe
from benchtool.report.compare.pooled import PooledFits
from benchtool.report.fit.result import Fit
from benchtool.report.result import (
    Data,
    Result,
    save_if_requested,
    saved_paths,
    temporary_folder,
)
from benchtool.results import fit_result, pool_result
from benchtool.table_fit import prepare_table


@keyword_messages()
@with_keywords(TableFitInputs, omit=("data", "model"))
def fit(
    data: Data | Sequence[Data] = (),
    model: str | Path | None = None,
    *,
    rpm: str | float = "",
    runs: Literal["", "none"] = "",
    permit: CodePermit = check_code_allowed,
    **options: Any,
) -> Fit:
    """Fit a ground-effect model to runs or tables, like `benchtool fit`.

    Parameters
    ----------
    data : str, Path, Result, DataFrame, mapping of arrays, or a sequence of these
        Run folders, CSV files, results of `read`, or tables in memory. Columns of a table are
        found by their names, or named by `z`, `thrust` and so on; units are in brackets in the
        column name, in ``attrs["units"]``, or `unit` and `z_unit`.
    model : str or Path, optional
        Name or path of a model file; default for tables: ``"single"``.
    rpm : str or float, optional
        Column of the rotor speed of a table, or one value in rpm.
    runs : str, optional
        ``"none"`` fits all runs of a table together; ``where="run=a"`` selects one.
    permit : callable, optional
        Called with user code of the model before it runs; by default this raises.

    Returns
    -------
    Fit
        Numbers: `params`, `covariance`, `residuals`, `samples`, `model`, `predict(z_over_R)`.
        Tables: `estimates`, `points` and `ratio`.

    Raises
    ------
    InputError
        The data or the model do not allow the fit.
    EstimationError
        No estimate is possible.

    Examples
    --------
    >>> import benchtool as bt
    >>> table = {"height": [80, 100, 130, 200, 400, 800], "rpm": 6 * [6000],
    ...          "F": [365.7, 350.5, 340.2, 332.0, 327.7, 326.7]}
    >>> fit = bt.fit(table, z="height", z_unit="mm", thrust="F", unit="gf", radius=0.127)
    >>> round(fit.params["R_m"].value, 3)
    0.105
    >>> fit.predict(z_over_R=[1.0, 2.0]).round(3)
    array([1.045, 1.011])
    """
    values = {name: value for name, value in options.items() if value is not None}
    values |= {"rpm": f"{rpm}"} if rpm not in ("", None) else {}
    values |= {"model": str(model)} if model is not None else {}
    values |= {"runs": runs} if runs else {}
    if paths := saved_paths(data):
        values["data"] = paths
    names = [item.name for item in items(TableFitInputs)]
    if unknown := [name for name in values if name not in names]:
        raise UnknownChoice("input", unknown[0], names)
    if "where" in values:
        values["where"] = read_texts(values["where"], commas=False)
    if paths and "recipe" not in values:
        _prepare_table(values)
    base = TableFitInputs(recipe=base_recipe(values))
    inputs = build_inputs(TableFitInputs, values, base=base)
    result = fit_result(inputs, permit=permit)
    for warning in result.found.warnings:
        warnings.warn(keyword_names(warning), DataWarning, stacklevel=4)  # the caller of `fit`
    return save_if_requested(result, inputs.out)


def _prepare_table(values: dict[str, Any]) -> None:
    """Add column map, rig and model of a table; assumptions are warnings."""
    table = {item.name: values[item.name] for item in items(TableInputs) if item.name in values}

    def warn(note: str) -> None:
        warnings.warn(keyword_names(note), DataWarning, stacklevel=7)  # the caller of `fit`

    inputs, folder = build_inputs(TableInputs, table), temporary_folder()
    if runs := prepare_table(values, inputs, lambda line: None, warn, folder=folder):
        raise InputError(
            f"runs={table['runs']!r} are {len(runs)} fits; call fit for each, for example with "
            f"where={runs[0]!r}"
        )


def pool(
    fits: Data | Sequence[Data],
    *,
    of: Sequence[str] = (),
    shared: Sequence[str] = (),
    seed: int = 1,
    out: str | Path | None = None,
) -> Result[PooledFits]:
    """Combine fits of several rigs in a hierarchical model, like `benchtool pool`.

    Parameters
    ----------
    fits : sequence of str or Path
        Folders of `benchtool fit --out` or ``bt.fit(..., out=)``, one per rig.
    of : sequence of str, optional
        Parameters that may differ between rigs; default: all without a unit.
    shared : sequence of str, optional
        Parameters that are equal in all rigs.
    seed : int, default 1
        Random seed.
    out : str or Path, optional
        New folder for report, figure and pool.json.

    Returns
    -------
    Result
        Tables: `rigs` and `differences`. Posterior draws are in `result.found.pooled`.

    Raises
    ------
    InputError
        Fewer than two fits, failed fits, or fits with common data.
    NotConverged
        The chains have not converged.

    Examples
    --------
    >>> import benchtool as bt
    >>> thrusts = {"a": [365.7, 350.5, 340.2, 332.0, 327.7, 326.7],
    ...            "b": [370.0, 353.0, 341.6, 332.6, 327.9, 326.7]}
    >>> for rig, thrust in thrusts.items():
    ...     table = {"z [mm]": [80, 100, 130, 200, 400, 800], "thrust [gf]": thrust}
    ...     fit = bt.fit(table, rpm=6000, radius=0.127, out=rig)
    >>> bt.pool(["a", "b"], of=["R_m"]).tables
    ('rigs', 'differences')
    """
    result = pool_result([Path(path) for path in saved_paths(fits)], of, shared, seed)
    return save_if_requested(result, out)
