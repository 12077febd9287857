"""Writer of an explanation: folder (page, figures, new model, next experiment) and JSON file."""

from __future__ import annotations

from itertools import count
from pathlib import Path
from typing import Any

from benchtool import __version__
from benchtool.core.errors import WouldOverwrite
from benchtool.core.rig_file import export_rig_reference
from benchtool.data.atomic import json_ready, replace_json, replace_text
from benchtool.explain.laws import DRAFT_NAME, FoundDependence, draft_effect
from benchtool.explain.next_steps import (
    MODEL,
    NEAREST,
    format_added_model,
    next_file,
    user_effect_names,
    with_nearest_effect,
)
from benchtool.explain.result import Explanation
from benchtool.report.answer.page import answer_page
from benchtool.report.answer.tables import unjudged_sentence
from benchtool.report.figure import render_figures, save_figures, write_whole
from benchtool.report.fit.page import refuse_full
from benchtool.report.page import PAGE, write_report

ANSWER = "answer.json"


def check_not_existing(folder: Path | None, json_file: Path | None) -> None:
    """Raise WouldOverwrite if the folder is not empty or the JSON file exists."""
    if folder is not None:
        refuse_full(folder, "--overwrite")
    if json_file is not None and json_file.exists():
        raise WouldOverwrite(str(json_file), "--overwrite")


def write_folder(
    folder: Path, answer: Explanation, display_path: Path | None = None
) -> dict[str, str]:
    """Write an explanation, replacing its files; return their paths by kind."""
    shown_folder, effects_file = display_path or folder, answer.request.effects_file
    folder.mkdir(parents=True, exist_ok=True)
    model = _write_model(folder, MODEL, answer if answer.effects else None, effects_file)
    nearest = _write_model(folder, NEAREST, with_nearest_effect(answer), effects_file)
    name, text = next_file(answer)
    if name:
        replace_text(folder / name, text)
    draft = ""
    if answer.depends is not None and answer.depends.law is not None:  # of an unnamed effect
        names = (f"{DRAFT_NAME}{'' if k == 1 else f'_{k}'}.py" for k in count(1))
        draft = next(file for file in names if not (folder / file).exists())
        replace_text(folder / draft, draft_effect(answer.depends))
    files = {"model": model, "schedule": name, "nearest": nearest, "draft": draft}
    written = {kind: str(shown_folder / file) for kind, file in files.items() if file}
    figures = render_figures("answer", answer)
    save_figures(figures, folder, replace=True)
    page = answer_page(answer, figures, name, str(shown_folder))
    write_report(folder / PAGE, page, replace=True)
    replace_json(folder / ANSWER, answer_tables(answer, **written))
    return written


def _write_model(
    folder: Path, name: str, answer: Explanation | None, effects_file: Path | None
) -> str:
    """Write the model with its rig and effects file; return its name, "" without a model."""
    if answer is None:
        return ""
    user_effects = ""
    if effects_file is not None and user_effect_names(answer):
        user_effects = effects_file.name
        write_whole(folder / user_effects, effects_file.read_bytes())
    rig, rig_text = export_rig_reference(answer.request.loaded.model.rig)
    if rig_text:
        replace_text(folder / rig, rig_text)
    replace_text(folder / name, format_added_model(answer, rig, user_effects))
    return name


def write_json(path: Path, answer: Explanation, folder: Path | None = None) -> None:
    """Write the JSON file of an explanation; replaces an existing file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if folder is None:
        replace_json(path, answer_tables(answer))
    else:
        replace_text(path, (folder / ANSWER).read_text(encoding="utf-8"))


VERSION = 2  # increased when a key is removed or changes its meaning, not for new keys


def answer_tables(answer: Explanation, **written: str) -> dict[str, Any]:
    """Return the contents of the JSON file with paths by kind; all keys are always present."""
    tables = {
        "version": VERSION,
        "verdict": answer.kind,
        "sentence": answer.sentence,
        "effects": [
            _fields(effect, "name", "title", "stage", "probability")
            | {
                "parameters": {
                    item.name: _fields(item, "value", "std", "unit", "determined", interval_95="")
                    | _fields(item, "tolerance", "neutral")
                    for item in effect.parameters
                }
            }
            | _fields(effect, "log_likelihood_ratio", "p_value")
            for effect in answer.effects
        ],
        "class": list(answer.class_members),
        "probabilities": dict(answer.probabilities),
        "places": [_fields(item, "effect", "probabilities") for item in answer.alternatives],
        "stages": dict(answer.stages),
        "unnamed": [
            _fields(effect, "name", "phrase", "stage", "probability", "share", "tolerances")
            for effect in answer.unnamed
        ],
        "where": _fields(answer.where, "stage", "regime", "size", "share"),
        "gap": {
            gap.channel: _fields(
                gap, "unit", "before", "after", "floor",
                floor_5_95="floor_", before_95="before_", after_95="after_",
            ) | _fields(gap, "as_given", "share_closed")
            for gap in answer.gaps
        },
        "nearest": _fields(answer.nearest and answer.nearest.effect, "name")
        | _fields(answer.nearest, "share_closed", "after")
        | {"model": written.get("nearest")},
        "depends": _depends(answer.depends, written.get("draft")),
        "tolerances": dict(answer.tolerances),
        "not_judged": {
            name: {"reason": unjudged.reason, "tolerances_needed": unjudged.size,
                   "sentence": unjudged_sentence(answer, name)}
            for name, unjudged in answer.not_judged.items()
        },
        "remarks": list(answer.remarks),
        "next_experiment": _next(answer, written.get("schedule")),
        "model_out": written.get("model"),
        "seconds": answer.seconds,
        **_fields(answer, "bench", "window_s", "draws", "seed", "simulated"),
        "model": answer.request.loaded.model.name,
        "data": {
            "learn": {source.name: source.sha256 for source in answer.request.learn},
            "check": {source.name: source.sha256 for source in answer.request.check},
        },
        "software": f"benchtool {__version__}",
    }  # fmt: skip
    return dict(json_ready(tables))


def _depends(dependence: FoundDependence | None, file: str | None) -> dict[str, Any]:
    """Return the dependence of an unnamed effect and the law drafted from it."""
    law = None if dependence is None else dependence.law
    return {
        "on": None if dependence is None else dependence.phrase,
        **_fields(dependence, "probability", "candidates", "closed"),
        "law": None if dependence is None else dependence.formula or None,
        "numbers": {} if law is None else law.values,
        "file": file,
    }


def _fields(item: Any, *names: str, **spans: str) -> dict[str, Any]:
    """Return attributes by name (None without an item), and [low, high] pairs of `spans`."""
    values = {name: getattr(item, name, None) for name in names}
    pairs = {
        key: [getattr(item, f"{stem}low"), getattr(item, f"{stem}high")]
        for key, stem in spans.items()
    }
    return values | pairs


def _next(answer: Explanation, path: str | None) -> dict[str, Any]:
    experiment = answer.next
    kind = None if experiment is None else "schedule" if experiment.schedule is not None else "plan"
    return {
        **_fields(experiment, "candidates", "title", "reason"),
        "kind": kind,
        "file": path,
        "text": None if experiment is None else next_file(answer)[1],
        **_fields(experiment, "expected", "minutes"),
    }
