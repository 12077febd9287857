"""result.json: results of a fit; see docs/reference."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from benchtool.core.errors import EstimationError, ModelRejected
from benchtool.core.fit_result import FitResult
from benchtool.core.rig_file import export_rig_reference
from benchtool.data.atomic import atomic_writer, json_ready, replace_json, replace_text
from benchtool.data.run.entry import FIT_FILE, FIT_FORMAT
from benchtool.data.run.entry import read_result as read_result
from benchtool.fit.diagnose import find_error
from benchtool.fit.run_recipe import FitOutput
from benchtool.physics.model_file import LoadedModel, model_to_toml

Answer = Literal["given", "model rejected", "none"]  # status of the fit's estimates


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
        "model": output.loaded.model.name,
        "rig": output.loaded.model.rig.name,
        "basis": output.recipe.basis,
        "simulated": output.data.points.simulated,
        "points": {
            "read": len(output.data.points),
            "used": len(output.data.rows),
            "left_out": list(output.data.left_out),
        },
        "results": {result.method: _result(result) for result in output.results},
    }
    if output.budget is not None:
        tables["budget"] = output.budget.tables()
    if output.comparison is not None:
        tables["comparison"] = {
            "sentence": output.comparison.sentence,
            "folds": output.comparison.folds,
            "settings": output.comparison.settings,
            "seed": output.comparison.seed,
            "scores": [asdict(score) for score in output.comparison.scores],
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
        _write_model(folder, output)
    for result in output.results:
        if len(result.samples):
            header = ",".join(estimate.name for estimate in result.estimates)
            path = folder / "samples.csv"
            with atomic_writer(path, path.with_name(f".{path.name}.new")) as file:
                np.savetxt(file, result.samples, "%.9g", delimiter=",", header=header, comments="")


def _write_model(folder: Path, output: FitOutput) -> None:
    problem = find_error(output.results)
    model = output.fitted
    if problem is not None:
        model = replace(model, provenance={**model.provenance, "rejected": str(problem)})
    fitted = LoadedModel(
        model=model, columns=output.loaded.columns, row_filter=output.loaded.row_filter
    )
    rig, text = export_rig_reference(model.rig)
    if text:
        replace_text(folder / rig, text)
    replace_text(folder / "model.toml", model_to_toml(fitted, rig))


def _result(result: FitResult) -> dict[str, Any]:
    tables = asdict(result)
    estimates, derived = (
        {item.pop("name"): item for item in tables[key]} for key in ("estimates", "derived")
    )
    return {
        "estimates": estimates,
        "derived": derived,
        "order": [item.name for item in result.estimates],
        "covariance": result.covariance.tolist(),
        "chi2": result.chi2,
        "dof": result.dof,
        "chi2_per_dof": result.chi2_per_dof,
        "log_likelihood": result.log_likelihood,
        "outcome": asdict(result.outcome),
        "warnings": list(result.warnings),
        "facts": dict(result.facts),
    }
