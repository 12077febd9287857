"""Command `benchtool demo`: sweep and fit of a virtual bench with the ordinary commands."""

from __future__ import annotations

import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from annotated_types import Ge

from benchtool.commands.input_commands import command_from_inputs
from benchtool.core.inputs import Input, Inputs

FIT = "--model quad_bench --method least_squares --method emcee --compare quad"


@dataclass(frozen=True, slots=True, kw_only=True)
class DemoInputs(Inputs):
    """Options of `benchtool demo`."""

    out: Annotated[Path | None, Input("New folder.", default_text="benchtool-demo")] = None
    seed: Annotated[int, Ge(0), Input("Random seed.")] = 1


@command_from_inputs(DemoInputs)
def demo(inputs: DemoInputs) -> None:
    """Sweep a virtual bench, fit and write a report."""
    from benchtool.data.run.run import free_path
    from benchtool.report.fit.page import refuse_full

    out = inputs.out or free_path(Path("benchtool-demo"))
    refuse_full(out)
    run, fit = out / "run", out / "fit"
    bench = f"sim:pquad?truth=virtual_pquad&seed={inputs.seed}"
    print("virtual bench with four rotors and K_b = 1.9; no motor turns")
    for arguments in (
        ["sweep", bench, "--plan", "demo_quad", "--yes", "--out", str(run)],
        ["fit", str(run), *FIT.split(), "--out", str(fit)],
    ):
        print(f"\n$ {shlex.join(['benchtool', *arguments])}", flush=True)
        process = subprocess.run([sys.executable, "-m", "benchtool", *arguments], check=False)
        if process.returncode:
            sys.exit(process.returncode)
    print(f"\nThe report: {(fit / 'report.html').resolve()}")
