"""Rig of measured data, and nominal model for a comparison with them.

A rig is recorded with the data or named by the user, never assumed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.core.rig_file import load_rig_by_name, rig_names
from benchtool.core.units import Array
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.atomic import data_hash
from benchtool.data.run.entry import read_result
from benchtool.data.run.read import fill_missing_parts, find_differences, load_rig_for_data
from benchtool.physics.model import Model
from benchtool.physics.model_file import load_model, model_names

DRAWS = 400  # parameter draws of an uncertainty band


def rig_for_data(data: Sequence[str], model: str, named: str | None = None) -> Rig | None:
    """Return the recorded rig, else the named one; None means the rig of a user's model file.

    A library model fits any rig, so the rig in its file is not evidence about the data. A named rig
    can add blade and motor data that the recorded rig lacks.

    Raises:
        InputError: data of two rigs, of another rig than the named one, or of an unknown rig.
    """
    recorded_rig = load_rig_for_data(data)
    if named is not None:
        named_rig = load_rig_by_name(named)
        if recorded_rig is not None and (mismatches := find_differences(recorded_rig, named_rig)):
            raise InputError(
                f"--rig {named} is not the rig that the data were recorded on ({mismatches[0]}); "
                f"omit --rig"
            )
        return named_rig if recorded_rig is None else fill_missing_parts(recorded_rig, named_rig)
    if recorded_rig is None and data and model in model_names():
        for path in data:
            data_hash(path)  # raises for a missing file
        raise InputError(
            f"{data[0]} does not say which rig it was measured on, and model {model!r} fits any "
            f"rig; name it with --rig: a library rig ({', '.join(rig_names())}) or your TOML file"
        )
    return recorded_rig


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NominalModel:
    """Model at its nominal values, with draws of uncertain parameters."""

    model: Model  # at its values
    draws: Mapping[str, Array] = field(default_factory=dict)  # (d, 1) by parameter; may be empty
    spread: str = ""  # source of the draws as text; empty without draws
    fitted_to: tuple[str, ...] = ()  # paths of the data of its fit; empty without a fit


def model_file(name: str) -> str:
    """Return the model file for a name; the folder of a fit or explanation means its model.toml."""
    path = Path(name)
    return str(path / "model.toml") if path.is_dir() else name


def nominal_model(name: str, rig: Rig, permit: CodePermit = check_code_allowed) -> NominalModel:
    """Return a model on a rig, with draws of its uncertain parameters.

    Draws are from the covariance in the result.json of the same folder (`benchtool fit --out`),
    else from the normal priors of the model.

    Raises:
        InputError: the fit was made on another rig.
    """
    path, rng = Path(model_file(name)), np.random.default_rng(0)
    draws: dict[str, Array] = {}
    fitted_to: tuple[str, ...] = ()
    spread = ""
    if (path.parent / "result.json").is_file() and path.suffix == ".toml":
        model = load_model(str(path), permit=permit).model
        if mismatches := find_differences(model.rig, rig):
            raise InputError(
                f"{path} was fitted on another rig than the run's ({mismatches[0]}); use a model "
                f"that was fitted on this rig"
            )
        tables = read_result(path.parent)
        result = next(iter(tables["results"].values()))
        names, covariance = list(result["order"]), np.array(result["covariance"], float)
        fitted_to = tuple(map(str, tables["recipe"]["data"]))
        if np.isfinite(covariance).all():
            values = np.array([result["estimates"][key]["value"] for key in names], float)
            samples = rng.multivariate_normal(
                values, covariance, DRAWS, method="svd", check_valid="ignore"
            )
            draws = {
                key: samples[:, [column]]
                for column, key in enumerate(names)
                if key in model.parameters and not key.startswith("noise.")
            }
            spread = f"covariance of the fit in {path.parent.resolve().name}"
    else:
        model = load_model(str(path), rig, permit).model
        for key, parameter in model.parameters.items():
            if parameter.prior.kind == "normal" and key != "inertia_kgm2":
                samples = rng.normal(parameter.value, parameter.prior.sd, (DRAWS, 1))
                draws[key] = np.clip(samples, parameter.lower, parameter.upper)
        spread = f"priors stated by {model.name}: {', '.join(draws)}" if draws else ""
    return NominalModel(model=model, draws=draws, spread=spread, fitted_to=fitted_to)
