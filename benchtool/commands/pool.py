"""Command `benchtool pool`: hierarchical model of the fits of several rigs."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from annotated_types import Ge

from benchtool.commands.input_commands import command_from_inputs
from benchtool.core.inputs import Input, Inputs


@dataclass(frozen=True, slots=True, kw_only=True)
class PoolInputs(Inputs):
    """Options of `benchtool pool`."""

    fits: Annotated[
        tuple[Path, ...], Input("Fit folders (benchtool fit --out), one per rig.", argument="FIT")
    ] = ()
    of: Annotated[
        tuple[str, ...],
        Input(
            "Parameter that may differ between rigs; repeatable.", default_text="all without a unit"
        ),
    ] = ()
    shared: Annotated[tuple[str, ...], Input("Parameter equal in all rigs; repeatable.")] = ()
    seed: Annotated[int, Ge(0), Input("Random seed.")] = 1
    out: Annotated[Path | None, Input("New folder for report, figure and pool.json.")] = None


@command_from_inputs(PoolInputs)
def pool(inputs: PoolInputs) -> None:
    """Combine fits of several rigs in a hierarchical model."""
    import sys

    from benchtool.commands.terminal.tables import Output, print_table
    from benchtool.report.compare.pooled import rigs_table
    from benchtool.report.fit.page import refuse_full
    from benchtool.results import pool_result

    if inputs.out is not None:
        refuse_full(inputs.out)
    result = pool_result(inputs.fits, inputs.of, inputs.shared, inputs.seed)
    print_table(Output(), rigs_table(result.found))
    print(result.summary())
    if inputs.out is not None:
        for path in result.save(inputs.out, [shlex.join(["benchtool", *sys.argv[1:]])]):
            print(f"written: {path}")
