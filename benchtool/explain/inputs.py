"""Inputs of an explanation, for command line, page and Python."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Gt, Le, Lt

from benchtool.core.inputs import Input, Inputs
from benchtool.tasks import Cluster


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplainInputs(Inputs):
    """Options of `benchtool explain`."""

    recordings: Annotated[
        tuple[str, ...],
        Input("Training recordings: CSV, Parquet, run folders.", argument="RECORDING"),
    ] = ()
    model: Annotated[
        str, Input("Model name (benchtool library models) or path of a model file.")
    ] = ""
    rig: Annotated[str | None, Input("Rig of a CSV file: name or path.")] = None
    check: Annotated[
        tuple[str, ...], Input("Validation recordings of the same bench; one or more.")
    ] = ()
    out: Annotated[
        Path | None, Input("Folder for report, figures, new model or next experiment.")
    ] = None
    json: Annotated[Path | None, Input("JSON file for the answer.")] = None
    effects: Annotated[
        str | None, Input("Python file or module with user-defined effects.", group="Search")
    ] = None
    seed: Annotated[int, Ge(0), Input("Random seed.")] = 0
    draws: Annotated[int, Ge(20), Le(100_000), Input("Noise draws for the noise floor.")] = 128
    bootstrap: Annotated[int, Ge(0), Input("Bootstrap draws for p-values; 0: asymptotic.")] = 0
    overwrite: Annotated[bool, Input("Replace existing files.")] = False
    cluster: Cluster = None
    bench: Annotated[
        str | None,
        Input(
            "Bench for the next experiments, each with arming confirmation.",
            group="Next experiments on a bench",
        ),
    ] = None
    until: Annotated[
        float, Gt(0.5), Lt(1.0), Input("With --bench: required probability of the verdict.")
    ] = 0.95
    most_experiments: Annotated[
        int, Ge(1), Le(20), Input("With --bench: maximum number of experiments.")
    ] = 3
    most_minutes: Annotated[
        float, Gt(0.0), Le(600.0), Input("With --bench: maximum total duration.", "min")
    ] = 30.0
    stage: Annotated[
        str | None,
        Input("With --bench: plate stage, as in benchtool sweep.", default_text="as in rig"),
    ] = None
