"""Write a fit's folder: result.json, the fitted model, samples, figures and the report page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from benchtool.core.errors import WouldOverwrite
from benchtool.fit.result_file import write_result
from benchtool.fit.run_recipe import FitOutput
from benchtool.report.files import save_figure
from benchtool.report.fit.figures import fit_figures
from benchtool.report.fit.page import fit_page
from benchtool.report.html import write_report


def refuse_full(folder: Path) -> None:
    """Refuse a folder that holds something already."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise WouldOverwrite(str(folder))


def write_fit(folder: Path, output: FitOutput, commands: Sequence[str] = ()) -> Path:
    """Write everything that a fit made into a new folder and return its report page.

    Raises:
        WouldOverwrite: the folder holds something already; nothing was written.
    """
    refuse_full(folder)
    folder.mkdir(parents=True, exist_ok=True)
    write_result(folder, output)
    figures = fit_figures(output)
    for name, figure in figures.items():
        save_figure(figure, folder / name)
    return write_report(folder / "report.html", fit_page(output, figures, commands))
