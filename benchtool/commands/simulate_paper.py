"""`benchtool simulate paper`: every claim of the paper about control, held against simulations."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer


def command(
    out: Annotated[Path | None, typer.Option(help="Folder for all figures and claims.csv.")] = None,
    sensitivity: Annotated[
        bool,
        typer.Option("--sensitivity/--no-sensitivity", help="Also change S3, one thing at a time."),
    ] = True,
) -> None:
    """Hold simulations against what the paper claims of control.

    Simulates its sections 2.4, 3 and 4, and prints what comes out of each claim.
    """
    from benchtool.commands.paper.bench import bench_claims
    from benchtool.commands.paper.claims import Flights, claim_csv, claim_lines
    from benchtool.commands.paper.flight import flight_claims
    from benchtool.commands.paper.sensitivity import sensitivity_claims
    from benchtool.physics.expression import can_compile

    if not can_compile():
        print(
            "numba is not installed, so this runs as plain Python and takes an hour; "
            "pip install benchtool[fast] makes it a minute",
            file=sys.stderr,
        )
    if out is not None:
        from benchtool.report.files import refuse_existing

        refuse_existing([out / "claims.csv"])
    flights = Flights()
    claims = [*flight_claims(flights), *bench_claims()]
    if sensitivity:
        claims += sensitivity_claims(flights)
    print("SIMULATED: claims of Int. J. Aerospace Eng. 2017, 1823056; gains are not the paper's,")
    print("which prints none: s3 is the set with which its results come out, stiff the contrast")
    for line in claim_lines(claims):
        print(line)
    if out is None:
        print("add --out FOLDER for the figures and claims.csv")
        return
    from benchtool.report.files import save_figure, write_whole
    from benchtool.report.paper.page import paper_figures

    write_whole(out / "claims.csv", claim_csv(claims).encode())
    print(f"written: {out / 'claims.csv'}")
    for name, block in paper_figures(flights):
        print(f"written: {save_figure(block.figure, out / name)[0]} and png", flush=True)
