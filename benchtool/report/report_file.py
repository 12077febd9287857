"""Report of a path: sweep, fit, explanation or recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from benchtool.core.errors import FileFormatError, InputError, WouldOverwrite
from benchtool.data.run.entry import ANSWER_FILE, FIT_FILE
from benchtool.data.run.read import is_pitch_run, is_run
from benchtool.data.run.recording_file import metadata_path

# Wrong paths are reported before the imports of a report, which take 2 s.
if TYPE_CHECKING:
    from benchtool.explain.pitch.replay import ReplayInputs
    from benchtool.report.compare.page import RunComparison
    from benchtool.report.page import Report

Kind = Literal["sweep", "pitch", "recording", "fit", "explanation"]
ACCEPTED_PATHS = (
    "a run folder of benchtool sweep or record, a folder of benchtool fit --out or explain --out, "
    "or a recording of benchtool import or simulate"
)
KIND_BY_FILE: dict[str, Kind] = {FIT_FILE: "fit", ANSWER_FILE: "explanation"}


def detect_kind(path: Path) -> Kind:
    """Return the kind of a path; FileFormatError if no report can be made of it."""
    if not path.exists():
        raise FileFormatError(str(path), f"file or folder not found; give {ACCEPTED_PATHS}")
    if path.is_dir():
        if is_run(path):
            return "pitch" if is_pitch_run(path) else "sweep"
        for name, kind in KIND_BY_FILE.items():
            if (path / name).is_file():
                return kind
        contents = ", ".join(sorted(item.name for item in path.iterdir())[:6]) or "nothing"
        raise FileFormatError(
            str(path), f"unknown kind of folder (contains: {contents}); give {ACCEPTED_PATHS}"
        )
    if metadata_path(path).is_file():
        return "recording"
    if is_run(path.parent):
        raise FileFormatError(str(path), f"file of a run; give the run folder {path.parent}")
    raise FileFormatError(
        str(path),
        f"metadata file {metadata_path(path).name} is missing; create a recording with "
        f"benchtool import {path}, or give {ACCEPTED_PATHS}",
    )


def check_paths(paths: Sequence[Path]) -> None:
    """Raise InputError if there is no path, or one that no report can be made of."""
    if not paths:
        raise InputError(f"no input; give {ACCEPTED_PATHS}")
    for path in paths:
        detect_kind(path)


def is_mixed(paths: Sequence[Path]) -> bool:
    """Return True for sweeps together with recordings, which need the comparison page."""
    return len(paths) > 1 and {*map(detect_kind, paths)} in ({"recording"}, {"sweep", "recording"})


def page_text(
    paths: Sequence[Path], replay_inputs: ReplayInputs | None = None, commands: Sequence[str] = ()
) -> str:
    """Return the report of the paths as HTML text."""
    from benchtool.report.page import PAGE, render_report

    kinds = [detect_kind(path) for path in paths]
    if len(paths) > 1 and set(kinds) != {"sweep"}:
        listed = ", ".join(f"{path} ({kind})" for path, kind in zip(paths, kinds, strict=True))
        raise InputError(f"several paths must all be sweeps: {listed}")
    if kinds[0] in KIND_BY_FILE.values():
        page = paths[0] / PAGE
        if not page.is_file():
            command = "benchtool fit" if kinds[0] == "fit" else "benchtool explain"
            raise FileFormatError(str(paths[0]), f"{PAGE} is missing; repeat {command} --out")
        return page.read_text("utf-8")
    return render_report(build_report(paths, kinds[0], replay_inputs, commands))


def build_report(
    paths: Sequence[Path],
    kind: Kind,
    replay_inputs: ReplayInputs | None = None,
    commands: Sequence[str] = (),
) -> Report:
    """Return the report of a sweep, a recording, or several sweeps."""
    from benchtool.explain.pitch.replay import ReplayInputs
    from benchtool.fit.nominal import nominal_model, rig_for_data
    from benchtool.report.replay.page import recording_page
    from benchtool.report.sweep.page import COMPARED, SWEEP
    from benchtool.report.sweep.run import read_sweep_run

    replay_inputs = replay_inputs or ReplayInputs()
    if kind != "sweep":
        return recording_page(paths[0], replay_inputs, commands)
    replay_inputs.check_unused("a sweep has no controller")
    first, model = read_sweep_run(paths[0]), None
    if replay_inputs.model:
        rig = rig_for_data([str(paths[0])], replay_inputs.model, replay_inputs.rig) or first.rig
        model = nominal_model(replay_inputs.model, rig, replay_inputs.permit)
    runs = [replace(first, model=model), *(read_sweep_run(path, model) for path in paths[1:])]
    return COMPARED.report(runs, commands) if len(runs) > 1 else SWEEP.report(runs[0], commands)


def write_report(
    paths: Sequence[Path],
    out: Path | None = None,
    *,
    replay_inputs: ReplayInputs | None = None,
    comparison: RunComparison | None = None,
    commands: Sequence[str] = (),
    replace: bool = False,
) -> Path:
    """Write the report of the paths as one self-contained HTML file.

    Without `out`, the existing page of a fit or an explanation is not written, only returned.
    """
    from benchtool.explain.pitch.replay import ReplayInputs
    from benchtool.report.compare.page import COMPARISON
    from benchtool.report.figure import write_whole
    from benchtool.report.page import PAGE, render_report

    check_paths(paths)
    path = paths[0]
    default_target = path / PAGE if path.is_dir() else path.with_name(f"{path.stem}-{PAGE}")
    target = out or (Path(PAGE) if len(paths) > 1 else default_target)
    if comparison is None and len(paths) == 1 and detect_kind(path) in KIND_BY_FILE.values():
        if replay_inputs not in (None, ReplayInputs()):
            raise InputError(
                f"{path} already has a page; --model and its options are only for runs and "
                f"recordings"
            )
        if target.resolve() == (path / PAGE).resolve() and target.is_file():
            return target
    if target.exists() and not replace:
        raise WouldOverwrite(str(target), "--overwrite")
    if comparison is not None:
        text = render_report(COMPARISON.report(comparison, commands))
    else:
        text = page_text(paths, replay_inputs, commands)
    write_whole(target, text.encode("utf-8"))
    return target
