"""`benchtool demo`: sweep a virtual bench, fit it and write the page, by the same commands."""

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

FIT = "--model quad_bench --method least_squares --method emcee --compare single --compare quad"


@dataclass(frozen=True, slots=True, kw_only=True)
class DemoInputs(Inputs):
    """What `benchtool demo` takes."""

    out: Annotated[
        Path | None, Input("New folder.", default_text="benchtool-demo, then benchtool-demo-2")
    ] = None
    seed: Annotated[int, Ge(0), Input("Seed of the virtual bench's noise.")] = 1


@command_from_inputs(DemoInputs)
def demo(inputs: DemoInputs) -> None:
    """Sweep two virtual benches, fit and write a report."""
    from benchtool.data.run.run import free_path
    from benchtool.report.fit.page import refuse_full

    out = inputs.out or free_path(Path("benchtool-demo"))
    refuse_full(out)
    run, fit = out / "run", out / "fit"
    bench = f"sim:pquad?truth=virtual_pquad&seed={inputs.seed}"
    print("a virtual bench of four rotors, made with K_b = 1.9; no motor turns anywhere")
    for words in (
        ["sweep", bench, "--plan", "demo_quad", "--yes", "--out", str(run)],
        ["fit", str(run), *FIT.split(), "--out", str(fit)],
    ):
        print(f"\n$ {shlex.join(['benchtool', *words])}", flush=True)
        done = subprocess.run([sys.executable, "-m", "benchtool", *words], check=False)
        if done.returncode:
            sys.exit(done.returncode)
    print(f"\nThe report: {(fit / 'report.html').resolve()}")
