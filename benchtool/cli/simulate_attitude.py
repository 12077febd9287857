"""`benchtool simulate attitude`: the moment against a tilt over ground (section 2.4, Fig. 9)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    rig: Annotated[str, typer.Option(help="Rig over the ground.")] = "pquad",
    out: Annotated[Path | None, typer.Option(help="Folder for the figure.")] = None,
) -> None:
    """Work out the restoring moment of a tilted vehicle.

    Once with each reading of the body term.
    """
    from benchtool.library import rig_named
    from benchtool.studies.attitude import attitude_moments, table_lines

    found = rig_named(rig)
    print(f"restoring moment of {found.title}, mN m (per cent of hover authority)")
    for line in table_lines(found):
        print(line)
    print(
        "always against the tilt. Eq. (10) puts the body's term into each rotor's thrust; a lift "
        "that acts on the body gives no moment, and the last table holds"
    )
    if out is not None:
        from benchtool.report.files import save_figure

        for path in save_figure(attitude_moments(found), out / "fig09-attitude"):
            print(f"written: {path}")
