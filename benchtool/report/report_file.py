"""One report of whatever a path names: a sweep, a fit, an explanation, a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from benchtool.core.errors import FileFormatError, InputError, WouldOverwrite
from benchtool.data.run.entry import ANSWER_FILE, FIT_FILE
from benchtool.data.run.read import is_pitch_run, is_run
from benchtool.data.run.recording_file import metadata_path as facts_beside
from benchtool.explain.pitch.replay import ReplayInputs
from benchtool.fit.data_rig import rig_for_data
from benchtool.fit.nominal import nominal_model
from benchtool.report import html
from benchtool.report.compare.page import COMPARISON, RunComparison
from benchtool.report.files import write_whole
from benchtool.report.page import Report
from benchtool.report.replay.page import recording_page
from benchtool.report.sweep.page import COMPARED, SWEEP
from benchtool.report.sweep.run import read_sweep_run

Kind = Literal["sweep", "pitch", "recording", "fit", "explanation"]
TAKES = (  # kinds of paths that a report is made of
    "a run folder of benchtool sweep or record, a folder of benchtool fit --out or explain --out, "
    "or a recording of benchtool import or simulate"
)
MARKS: dict[str, Kind] = {FIT_FILE: "fit", ANSWER_FILE: "explanation"}  # each has its report.html
PAGE = "report.html"


def kind_of(path: Path) -> Kind:
    """Return the kind of a path; FileFormatError where no report can be made of it."""
    if not path.exists():
        raise FileFormatError(str(path), f"there is no such file or folder; name {TAKES}")
    if path.is_dir():
        if is_run(path):
            return "pitch" if is_pitch_run(path) else "sweep"
        for name, kind in MARKS.items():
            if (path / name).is_file():
                return kind
        inside = ", ".join(sorted(item.name for item in path.iterdir())[:6]) or "nothing"
        raise FileFormatError(str(path), f"this folder (it holds: {inside}) is none of {TAKES}")
    if facts_beside(path).is_file():
        return "recording"
    if is_run(path.parent):
        raise FileFormatError(str(path), f"this is a file of a run; name its folder, {path.parent}")
    raise FileFormatError(
        str(path),
        f"this file has no {facts_beside(path).name} beside it; make a recording of it with "
        f"benchtool import {path}, or name {TAKES}",
    )


def is_mixed(paths: Sequence[Path]) -> bool:
    """Return whether several paths name runs and recordings that no page of sweeps can compare."""
    if len(paths) < 2:
        return False
    kinds = {kind_of(path) for path in paths}
    return "recording" in kinds and kinds <= {"sweep", "recording"}


def page_text(
    paths: Sequence[Path], beside: ReplayInputs | None = None, commands: Sequence[str] = ()
) -> str:
    """Return the report of what the paths name as HTML text."""
    beside = beside or ReplayInputs()
    kinds = [kind_of(path) for path in paths]
    if len(paths) > 1 and set(kinds) != {"sweep"}:
        listed = ", ".join(f"{path} ({kind})" for path, kind in zip(paths, kinds, strict=True))
        raise InputError(f"several runs are compared where all are sweeps, but these are: {listed}")
    if kinds[0] in ("fit", "explanation"):
        return _written_page(paths[0], kinds[0])
    return html.render_report(_made(paths, kinds[0], beside, commands))


def write_report(
    paths: Sequence[Path],
    out: Path | None = None,
    *,
    beside: ReplayInputs | None = None,
    comparison: RunComparison | None = None,
    commands: Sequence[str] = (),
    replace: bool = False,
) -> Path:
    """Write the report of what the paths name as one self-contained HTML file.

    Without `out`, the path of the page that a fit or an explanation already has is returned.
    """
    if not paths:
        raise InputError(f"nothing to report: name {TAKES}")
    path = paths[0]
    beside_it = path / PAGE if path.is_dir() else path.with_name(f"{path.stem}-{PAGE}")
    target = out or (Path(PAGE) if len(paths) > 1 else beside_it)
    own = comparison is None and len(paths) == 1 and kind_of(paths[0]) in ("fit", "explanation")
    if own and beside not in (None, ReplayInputs()):
        raise InputError(
            f"the page of {paths[0]} was written when it was made; --model and what goes with it "
            f"are for runs and recordings"
        )
    if own and target.resolve() == (paths[0] / PAGE).resolve() and target.is_file():
        return target
    if target.exists() and not replace:
        raise WouldOverwrite(str(target), "--overwrite")
    if comparison is not None:
        text = html.render_report(COMPARISON.report(comparison, commands))
    else:
        text = page_text(paths, beside, commands)
    write_whole(target, text.encode("utf-8"))
    return target


def _made(
    paths: Sequence[Path], kind: Kind, beside: ReplayInputs, commands: Sequence[str]
) -> Report:
    if kind != "sweep":
        return recording_page(paths[0], beside, commands)
    beside.refuse_controller("a sweep has no controller")
    first = read_sweep_run(paths[0])
    model = None
    if beside.model:
        rig = rig_for_data([str(paths[0])], beside.model, beside.rig) or first.rig
        model = nominal_model(beside.model, rig, beside.permit)
    runs = [replace(first, model=model), *(read_sweep_run(path, model) for path in paths[1:])]
    return COMPARED.report(runs, commands) if len(runs) > 1 else SWEEP.report(runs[0], commands)


def _written_page(path: Path, kind: Kind) -> str:
    page = path / PAGE
    if not page.is_file():
        made = "benchtool fit" if kind == "fit" else "benchtool explain"
        raise FileFormatError(
            str(path), f"there is no {PAGE} in it, which {made} --out writes; make it again"
        )
    return page.read_text("utf-8")
