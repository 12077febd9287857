"""result.json: results of a fit; see docs/reference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, asdict, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from benchtool.core.errors import EstimationError, FileFormatError, ModelRejected
from benchtool.core.fit_result import Estimate, FitResult
from benchtool.core.rig_file import export_rig_reference
from benchtool.data.atomic import atomic_writer, json_ready, replace_json, replace_text
from benchtool.data.run.entry import FIT_FILE, FIT_FORMAT, read_result
from benchtool.fit.compare import Comparison
from benchtool.fit.compare_laws import LawComparison
from benchtool.fit.diagnose import find_error
from benchtool.fit.run_recipe import FitOutput, FitSummary
from benchtool.fit.uncertainty.budget import parse_budget, with_budget
from benchtool.physics.model_file import LoadedModel, model_to_toml

T = TypeVar("T")
Answer = Literal["given", "model rejected", "none"]  # status of the fit's estimates
RESULT_KEYS = (
    *("estimates", "derived", "order", "covariance", "chi2", "dof", "chi2_per_dof"),
    *("log_likelihood", "outcome", "warnings", "facts"),
)


def result_tables(output: FitOutput) -> dict[str, Any]:
    """Return the contents of result.json."""
    # File names only, without folders of one machine.
    recipe = asdict(output.recipe)
    recipe["data"] = [Path(name).name for name in output.recipe.data]
    recipe["model"] = Path(output.recipe.model).name
    recipe["compare"] = [Path(name).name for name in output.recipe.compare]
    problem = find_error(output.results)
    answer: Answer = "model rejected" if isinstance(problem, ModelRejected) else "given"
    if isinstance(problem, EstimationError):
        answer = "none"
    tables: dict[str, Any] = {
        "format": FIT_FORMAT,
        "answer": answer,
        "problem": "" if problem is None else str(problem),
        "recipe": recipe,
        "model": output.model,
        "rig": output.rig,
        "basis": output.basis,
        "simulated": output.simulated,
        "points": {
            "read": output.read,
            "used": output.used,
            "left_out": list(output.left_out),
        },
        "results": {result.method: _result_table(result) for result in output.results},
    }
    if output.budget is not None:
        tables["budget"] = output.budget.tables()
    if output.comparison is not None:
        tables["comparison"] = {
            "sentence": output.comparison.sentence,
            **asdict(output.comparison),
        }
    if output.laws is not None:
        tables["laws"] = {"sentence": output.laws.sentence, **asdict(output.laws)}
    cleaned: dict[str, Any] = json_ready(tables)
    return cleaned


def write_result(folder: Path, output: FitOutput) -> None:
    """Write result.json, the fitted model and the posterior samples into a folder.

    A failed fit has no model file.
    """
    tables = result_tables(output)
    replace_json(folder / FIT_FILE, tables)
    if tables["answer"] != "none":
        model, loaded = output.fitted, output.loaded
        if tables["problem"]:
            model = replace(model, provenance={**model.provenance, "rejected": tables["problem"]})
        rig, text = export_rig_reference(model.rig)
        if text:
            replace_text(folder / rig, text)
        fitted = LoadedModel(model=model, columns=loaded.columns, row_filter=loaded.row_filter)
        replace_text(folder / "model.toml", model_to_toml(fitted, rig))
    for result in output.results:
        if len(result.samples):
            header = ",".join(estimate.name for estimate in result.estimates)
            path = folder / "samples.csv"
            with atomic_writer(path, path.with_name(f".{path.name}.new")) as file:
                np.savetxt(file, result.samples, "%.9g", delimiter=",", header=header, comments="")


def _result_table(result: FitResult) -> dict[str, Any]:
    tables = asdict(result)
    for key in ("estimates", "derived"):
        tables[key] = {item.pop("name"): item for item in tables[key]}
    tables["order"] = [item.name for item in result.estimates]
    tables["chi2_per_dof"] = result.chi2_per_dof
    tables["covariance"] = result.covariance.tolist()
    return {key: tables[key] for key in RESULT_KEYS}


def read_fit(folder: Path) -> FitSummary:
    """Read the fit of a folder."""
    return parse_fit(read_result(folder), str(folder / FIT_FILE))


def parse_fit(tables: Mapping[str, Any], where: str) -> FitSummary:
    """Parse the contents of a result.json; `where` is its location for error messages."""
    try:
        shared = {"model": tables["model"], "basis": tables["basis"]}
        results = tuple(
            _parse_result(method, {**table, **shared})
            for method, table in tables["results"].items()
        )
        if not results:
            raise FileFormatError(where, "results are empty; fit again")
        budget = parse_budget(tables["budget"]) if tables.get("budget") else None
        return _build(
            FitSummary,
            {"rig": "", **tables, **tables["points"]},
            results=with_budget(results, budget),
            comparison=_parse_scores(Comparison, tables.get("comparison")),
            budget=budget,
            laws=_parse_scores(LawComparison, tables.get("laws")),
        )
    except KeyError as error:
        raise FileFormatError(where, f"key {error} is missing; fit again") from error
    except (TypeError, ValueError, AttributeError) as error:
        raise FileFormatError(where, f"invalid fit result ({error}); fit again") from error


def _parse_result(method: str, table: Mapping[str, Any]) -> FitResult:
    order, estimates, derived = table["order"], table["estimates"], table["derived"]
    return _build(
        FitResult,
        table,
        method=method,
        estimates=tuple(_build(Estimate, estimates[name], name=name) for name in order),
        derived=tuple(_build(Estimate, item, name=name) for name, item in derived.items()),
        covariance=np.array(table["covariance"], float),
        warnings=tuple(table["warnings"]),
        facts=table["facts"],
    )


def _parse_scores(cls: type[T], table: Mapping[str, Any] | None) -> T | None:
    counts = dict.fromkeys(("folds", "settings", "seed"), 0)  # optional in the file
    return _build(cls, counts | dict(table)) if table else None


def _build(cls: type[T], table: Mapping[str, Any], **values: Any) -> T:
    """Build a dataclass from a table by its field types; fields with defaults are optional."""
    record: Any = cls
    kinds = get_type_hints(cls)
    for item in fields(record):
        is_required = item.default is item.default_factory is MISSING
        if item.name not in values and (is_required or item.name in table):
            values[item.name] = _parse(table[item.name], kinds[item.name])
    instance: T = cls(**values)
    return instance


def _parse(value: Any, kind: Any) -> Any:
    """Convert a JSON value to its type; null means nan."""
    if isinstance(kind, type) and is_dataclass(kind):
        return _build(kind, value)
    if get_origin(kind) is tuple:
        return tuple(_parse(item, get_args(kind)[0]) for item in value)
    if kind is float:
        return float("nan") if value is None else float(value)
    return kind(value) if kind in (bool, int, str) else value
