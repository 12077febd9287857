"""result.json: everything that a fit found, for people and programs; see docs/reference."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from benchtool.core.errors import BenchtoolError, EstimationError, ModelRejected
from benchtool.core.fit_result import FitResult
from benchtool.core.rig_file import rig_beside
from benchtool.data.atomic import json_ready, replace_json, replace_text
from benchtool.data.run.entry import FIT_FILE, FIT_FORMAT
from benchtool.data.run.entry import read_result as read_result
from benchtool.fit.diagnose import refusal
from benchtool.fit.run_recipe import FitOutput
from benchtool.physics.model_file import LoadedModel, model_to_toml

Answer = Literal["given", "model rejected", "none"]
"""Whether a fit has an answer, and whether the data reject its model."""


def result_tables(output: FitOutput) -> dict[str, Any]:
    """Return the contents of result.json."""
    problem = refusal(output.results)
    tables: dict[str, Any] = {
        "format": FIT_FORMAT,
        "answer": _answer(problem),
        "problem": "" if problem is None else str(problem),
        "recipe": _paths_as_names(output),
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
    if output.comparison is not None:
        tables["comparison"] = {
            "sentence": output.comparison.sentence,
            "folds": output.comparison.folds,
            "settings": output.comparison.settings,
            "seed": output.comparison.seed,
            "scores": [asdict(score) for score in output.comparison.scores],
        }
    cleaned: dict[str, Any] = json_ready(tables)
    return cleaned


def write_result(folder: Path, output: FitOutput) -> None:
    """Write result.json, the fitted model and the posterior samples into a folder.

    A fit without an answer has no model to write.
    """
    tables = result_tables(output)
    replace_json(folder / FIT_FILE, tables)
    if tables["answer"] != "none":
        _write_model(folder, output)
    for result in output.results:
        if len(result.samples):
            header = ",".join(estimate.name for estimate in result.estimates)
            path = folder / "samples.csv"
            np.savetxt(path, result.samples, delimiter=",", header=header, comments="", fmt="%.9g")


def _answer(problem: BenchtoolError | None) -> Answer:
    if isinstance(problem, EstimationError):
        return "none"
    return "model rejected" if isinstance(problem, ModelRejected) else "given"


def _write_model(folder: Path, output: FitOutput) -> None:
    problem = refusal(output.results)
    model = output.fitted
    if problem is not None:
        model = replace(model, provenance={**model.provenance, "rejected": str(problem)})
    fitted = LoadedModel(
        model=model, columns=output.loaded.columns, row_filter=output.loaded.row_filter
    )
    rig, text = rig_beside(model.rig)
    if text:
        replace_text(folder / rig, text)
    replace_text(folder / "model.toml", model_to_toml(fitted, rig))


def _result(result: FitResult) -> dict[str, Any]:
    def estimates(items: Any) -> dict[str, Any]:
        return {
            item.name: {
                "unit": item.unit,
                "value": item.value,
                "sd": item.sd,
                "interval_68": list(item.interval_68),
                "interval_95": list(item.interval_95),
                "bound": item.bound,
            }
            for item in items
        }

    return {
        "estimates": estimates(result.estimates),
        "derived": estimates(result.derived),
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


def _paths_as_names(output: FitOutput) -> dict[str, Any]:
    """Return the recipe with its data named as given, without folders of one machine."""
    recipe = asdict(output.recipe)
    recipe["data"] = [Path(name).name for name in output.recipe.data]
    recipe["model"] = Path(output.recipe.model).name
    recipe["compare"] = [Path(name).name for name in output.recipe.compare]
    return recipe
