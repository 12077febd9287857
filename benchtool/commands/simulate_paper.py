"""`benchtool simulate paper`: every claim of the paper about control, held against simulations."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from benchtool.commands.declared import declared
from benchtool.commands.recipe_options import PaperLayoutInputs
from benchtool.commands.simulate_options import say_if_slow
from benchtool.core.errors import InputError
from benchtool.core.inputs import Input, Inputs, changed, values_of


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperInputs(Inputs):
    """What `benchtool simulate paper` takes."""

    out: Annotated[Path | None, Input("Folder for all figures and claims.csv.")] = None
    sensitivity: Annotated[bool, Input("Also change S3, one thing at a time.")] = True
    recipes: PaperLayoutInputs = field(default_factory=PaperLayoutInputs)


@declared(PaperInputs)
def paper(inputs: PaperInputs) -> None:
    """Hold simulations against what the paper claims of control.

    Simulates its sections 2.4, 3 and 4, and prints what comes out of each claim.
    """
    from benchtool.commands.paper_claims import (
        Flights,
        claim_csv,
        claim_lines,
        paper_claims,
        sensitivity_claims,
    )
    from benchtool.report.paper.layouts import fits_of

    out, recipes = inputs.out, values_of(inputs.recipes)
    if out is None and (named := changed(inputs.recipes)):
        raise InputError(f"--{next(iter(named))} draws points of runs; it needs --out")
    say_if_slow("takes an hour", "a minute")
    if out is not None:
        from benchtool.report.files import refuse_existing

        refuse_existing([out / "claims.csv"])
    flights = Flights(fits=fits_of(recipes))
    claims = paper_claims(flights)
    if inputs.sensitivity:
        claims += sensitivity_claims(flights)
    print("SIMULATED: claims of Int. J. Aerospace Eng. 2017, 1823056; gains are not the paper's,")
    print("which prints none: s3 is the set with which its results come out, stiff the contrast")
    for line in claim_lines(claims):
        print(line)
    if out is None:
        print("add --out FOLDER for the figures and claims.csv")
        return
    from benchtool.report.files import save_figure, write_whole
    from benchtool.report.paper.flights import paper_figures

    write_whole(out / "claims.csv", claim_csv(claims).encode())
    print(f"written: {out / 'claims.csv'}")
    for name, block in paper_figures(flights):
        print(f"written: {save_figure(block.figure, out / name)[0]} and png", flush=True)
