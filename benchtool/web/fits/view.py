"""A kept fit as the page shows it: what `benchtool fit` prints, and its figures."""

from __future__ import annotations

from pathlib import Path

from benchtool.report.page import Paragraph
from benchtool.store.runs_folder import RunsFolder
from benchtool.web.drawing import pieces, read_drawing
from benchtool.web.shown import Shown


def view_fit(root: Path, name: str) -> Shown:
    """Return what `benchtool fit` prints of a kept fit, and its figures."""
    from benchtool.recipes.fit_page import CAPTIONS
    from benchtool.recipes.kept_fit import SIMULATED, figure_files, read_kept

    path = RunsFolder(root).path_of(name)
    kept = read_kept(path)
    told = [block for block in kept.told if block != Paragraph(SIMULATED)]
    warnings, rest = told[-1], told[1:-1]
    files = figure_files(path)
    figures = [read_drawing(file, CAPTIONS[key]) for key, file in files.items()]
    return Shown(
        title=name,
        pieces=pieces([told[0], warnings, *figures[:1], *rest, *figures[1:]]),
        simulated=kept.simulated,
        command=("report", str(path)),
    )
