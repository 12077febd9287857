"""A model beside measurements, and how uncertain its numbers are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.run.run_rig import differences
from benchtool.fit.result_file import read_result
from benchtool.physics.model import Model
from benchtool.physics.model_file import load_model

DRAWS = 400  # parameter draws behind a band


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NominalModel:
    """Hold a model at its nominal values, with how uncertain they are.

    Attributes:
        draws: (d, 1) by parameter: values as likely as these; empty where nothing gives any.
        fitted_to: names of the data that its fit took; empty for a model nobody fitted here.
    """

    model: Model  # at its values
    draws: Mapping[str, Array] = field(default_factory=dict)
    spread: str = ""  # where the draws come from, in words; empty where nothing gives any
    fitted_to: tuple[str, ...] = ()


def model_file(name: str) -> str:
    """Return the model that a name means: a fit's or explanation's folder means its model.toml."""
    path = Path(name)
    return str(path / "model.toml") if path.is_dir() else name


def nominal_model(name: str, rig: Rig, permit: CodePermit = check_code_allowed) -> NominalModel:
    """Return a model on a rig, with draws of its uncertain numbers.

    They come from the covariance in the result.json beside it (`benchtool fit --out`), else from
    normal priors that it states.

    Raises:
        InputError: the fit was made on another rig.
    """
    path = Path(model_file(name))
    if (path.parent / "result.json").is_file() and path.suffix == ".toml":
        return _fitted(path, rig, permit)
    model = load_model(str(path), rig, permit).model
    rng = np.random.default_rng(0)
    draws = {}
    for key, item in model.parameters.items():
        if item.prior.kind == "normal" and key != "inertia_kgm2":
            drawn = rng.normal(item.value, item.prior.sd, (DRAWS, 1))
            draws[key] = np.clip(drawn, item.lower, item.upper)
    words = f"priors stated by {model.name}: {', '.join(draws)}" if draws else ""
    return NominalModel(model=model, draws=draws, spread=words)


def _fitted(path: Path, rig: Rig, permit: CodePermit) -> NominalModel:
    loaded = load_model(str(path), permit=permit)
    if different := differences(loaded.model.rig, rig):
        raise InputError(
            f"{path} was fitted on another rig than the run's ({different[0]}); name a model that "
            f"was fitted on this one"
        )
    tables = read_result(path.parent)
    result = next(iter(tables["results"].values()))
    names = list(result["order"])
    covariance = np.array(result["covariance"], float)
    fitted_to = tuple(str(item) for item in tables["recipe"]["data"])
    if not np.isfinite(covariance).all():
        return NominalModel(model=loaded.model, fitted_to=fitted_to)
    values = np.array([result["estimates"][key]["value"] for key in names], float)
    rng = np.random.default_rng(0)
    drawn = rng.multivariate_normal(values, covariance, DRAWS, method="svd", check_valid="ignore")
    draws = {
        key: drawn[:, [column]]
        for column, key in enumerate(names)
        if key in loaded.model.parameters and not key.startswith("noise.")
    }
    words = f"covariance of the fit in {path.parent.resolve().name}"
    return NominalModel(model=loaded.model, draws=draws, spread=words, fitted_to=fitted_to)
