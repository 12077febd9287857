"""Write an answer: its folder with page, figures, new model and next experiment, and its JSON."""

from __future__ import annotations

from pathlib import Path

from benchtool.core.errors import WouldOverwrite
from benchtool.core.rig_file import rig_beside
from benchtool.data.atomic import replace_json, replace_text
from benchtool.explain.added_model import MODEL, added_model, own_names
from benchtool.explain.answer import Answer
from benchtool.explain.next_steps import next_file
from benchtool.report.answer.file import Written, answer_tables
from benchtool.report.answer.page import answer_page
from benchtool.report.figure import drawn
from benchtool.report.files import save_figure, write_whole
from benchtool.report.html import write_report

PAGE = "report.html"
ANSWER = "answer.json"


def refuse_taken(folder: Path | None, json_file: Path | None) -> None:
    """Refuse targets that hold something already, before an answer is worked out.

    Raises:
        WouldOverwrite: a folder with files in it, or a file.
    """
    if folder is not None and folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise WouldOverwrite(str(folder), "--overwrite")
    if json_file is not None and json_file.exists():
        raise WouldOverwrite(str(json_file), "--overwrite")


def write_folder(
    folder: Path,
    answer: Answer,
    effects_file: Path | None = None,
    called: Path | None = None,
) -> Written:
    """Write everything of an answer and return where programs find model and next experiment.

    Args:
        folder: made where it is not there; files of these names are replaced.
        answer: what is written.
        effects_file: the user's own effects; copied beside a model that has one of them.
        called: the name that the folder will have; its present one when None.
    """
    known = called or folder
    folder.mkdir(parents=True, exist_ok=True)
    model = ""
    if answer.has_model:
        own = effects_file if own_names(answer) else None
        if own is not None:
            write_whole(folder / own.name, own.read_bytes())
        rig, rig_text = rig_beside(answer.request.loaded.model.rig)
        if rig_text:
            replace_text(folder / rig, rig_text)
        replace_text(folder / MODEL, added_model(answer, rig, own.name if own is not None else ""))
        model = str(known / MODEL)
    name, text = next_file(answer)
    if name:
        replace_text(folder / name, text)
    written = Written(model=model, schedule=str(known / name) if name else "")
    figures = drawn("answer", answer)
    for stem, block in figures.items():
        save_figure(block.figure, folder / stem, replace=True)
    page = answer_page(answer, figures, name, str(known))
    write_report(folder / PAGE, page, replace=True)
    write_json(folder / ANSWER, answer, written)
    return written


def write_json(path: Path, answer: Answer, written: Written) -> None:
    """Write the answer for programs; replaces a file of that name."""
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_json(path, answer_tables(answer, written))
