"""What an explanation takes, from the command line, the page or Python."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Gt, Le, Lt

from benchtool.core.inputs import Input, Inputs
from benchtool.tasks import Cluster


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplainInputs(Inputs):
    """What `benchtool explain` takes."""

    recordings: Annotated[
        tuple[str, ...],
        Input(
            "To learn from: CSV, Parquet of benchtool import, run folders.", argument="RECORDING"
        ),
    ] = ()
    model: Annotated[
        str, Input("Model name (benchtool library models) or path of a model file.")
    ] = ""
    rig: Annotated[str | None, Input("Rig of a CSV: shipped name or path; runs carry theirs.")] = (
        None
    )
    check: Annotated[
        tuple[str, ...], Input("To check on: same bench, not learned from; one or more.")
    ] = ()
    out: Annotated[
        Path | None, Input("Folder for page, figures, new model or next experiment.")
    ] = None
    json: Annotated[Path | None, Input("File for the answer as JSON.")] = None
    effects: Annotated[
        str | None, Input("Python file or module with effects of your own.", group="Search")
    ] = None
    seed: Annotated[int, Ge(0), Input("Seed of everything random.")] = 0
    draws: Annotated[int, Ge(20), Le(100_000), Input("Draws of the noise behind the floor.")] = 128
    bootstrap: Annotated[
        int, Ge(0), Input("Simulated records behind p-values; asymptotic ones without.")
    ] = 0
    overwrite: Annotated[bool, Input("Replace an earlier answer's files.")] = False
    cluster: Cluster = None
    bench: Annotated[
        str | None,
        Input(
            "Address of the bench: record next experiments on it, each armed anew.",
            group="Next experiments on a bench",
        ),
    ] = None
    until: Annotated[
        float, Gt(0.5), Lt(1.0), Input("With --bench: how probable the answer shall become.")
    ] = 0.95
    most_experiments: Annotated[int, Ge(1), Le(20), Input("With --bench: experiments at most.")] = 3
    most_minutes: Annotated[
        float, Gt(0.0), Le(600.0), Input("With --bench: minutes of experiments at most.", "min")
    ] = 30.0
    stage: Annotated[
        str | None,
        Input(
            "With --bench: what moves the plate, as of benchtool sweep.", default_text="as rig says"
        ),
    ] = None
