"""Where the page finds recordings and models: the runs folder, and the examples of a checkout."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from benchtool.core.errors import BenchtoolError, InputError
from benchtool.core.inputs import to_arguments, with_changes
from benchtool.core.parsed_text import parse_toml
from benchtool.core.user_file import MAX_TEXT_BYTES, read_text
from benchtool.data.catalogue.index import list_entries
from benchtool.data.csv_text import read_csv_header
from benchtool.data.run.entry import SWEEPS, Entry
from benchtool.data.run.read import sample_names
from benchtool.data.run.recording_file import FORMAT, metadata_path
from benchtool.data.run.run_metadata import read_recording_facts
from benchtool.data.run.run_rig import load_rig_for_data
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.explain.inputs import ExplainInputs
from benchtool.fit.data_rig import rig_for_data
from benchtool.physics.model_file import model_names
from benchtool.web.tabs.fit.model_choice import model_choices, model_path, suggested_rig


def command_words(inputs: ExplainInputs, out: Path) -> list[str]:
    """Return the words behind `benchtool` that explain the same and write the same folder."""
    return ["explain", *to_arguments(ExplainInputs, with_changes(replace(inputs, out=out)))]


def explain_inputs(
    sources: RecordingSources,
    learn: Sequence[str],
    check: Sequence[str],
    model: str,
    rig: str | None = None,
) -> ExplainInputs:
    """Return the inputs of the command for some choices.

    Raises:
        InputError: something is missing (the rig, too), a choice leads elsewhere, or one recording
            is in both.
    """
    if not learn:
        raise InputError(
            "no recording to learn from is chosen; choose one or more, save one under Simulate, or "
            "record one under Bench"
        )
    if not check:
        raise InputError(
            "no recording to check on is chosen; choose one of the same bench that is not learned "
            "from"
        )
    if both := set(learn) & set(check):
        raise InputError(
            f"{', '.join(sorted(both))} is to learn from and to check on; a model is checked on "
            f"what it did not learn from, so choose another"
        )
    if not model:
        raise InputError("no model is chosen; choose the one that should explain the recordings")
    inputs = ExplainInputs(
        recordings=tuple(str(sources.path_of(name)) for name in learn),
        check=tuple(str(sources.path_of(name)) for name in check),
        model=sources.model_of(model),
        rig=suggested_rig(rig, sources.runs),
    )
    rig_for_data((*inputs.recordings, *inputs.check), inputs.model, inputs.rig)
    return inputs


def suggested_folder(sources: RecordingSources, learn: Sequence[str], date: str) -> Path:
    """Return a free folder for the answer about some recordings."""
    first = Path(learn[0].rsplit("/", 1)[-1]).stem if learn else "recording"
    stem = re.sub(r"[^A-Za-z0-9_-]+", "-", first).strip("-_")[:40] or "recording"
    return sources.runs.free_path(date, f"explain-{stem}")


EXAMPLE = "example: "  # prefix of recordings of a checkout; no run has a colon
RECORDED = (*SWEEPS, "pitch recording", "recording", "table")  # kinds that can be explained


def examples_folder() -> Path | None:
    """Return the example recordings that stand beside the package, where there are any.

    As short as a command may name it from where the server was started.
    """
    folder = Path(__file__).parents[4] / "datasets"
    if not (folder / "pitch_friction").is_dir():
        return None
    here = Path.cwd()
    return folder.relative_to(here) if folder.is_relative_to(here) else folder


class RecordingChoices(NamedTuple):
    """Hold recordings and models by their choice, with words for people."""

    recordings: dict[str, str]
    models: dict[str, str]


class RecordingSources(NamedTuple):
    """List what can be chosen, and lead from a choice to its path; nothing else has one."""

    runs: RunsFolder
    examples: RunsFolder | None = None

    @classmethod
    def of(cls, root: Path) -> RecordingSources:
        examples = examples_folder()
        return cls(RunsFolder(root), RunsFolder(examples) if examples else None)

    def choices(self) -> RecordingChoices:
        """Read what can be chosen; the newest run first, the examples last. It reads files."""
        entries = list_entries(self.runs)
        recordings = _recordings(entries)
        models = dict(model_choices(self.runs, entries))
        models |= {name: name for name in _model_files(self.runs) if name not in models}
        if self.examples is not None:
            examples = sorted(list_entries(self.examples), key=lambda entry: entry.name)
            recordings |= {EXAMPLE + k: EXAMPLE + text for k, text in _recordings(examples).items()}
            models |= {EXAMPLE + name: EXAMPLE + name for name in _model_files(self.examples)}
        return RecordingChoices(recordings=recordings, models=models)

    def path_of(self, choice: str) -> Path:
        """Return the path of a recording.

        Raises:
            InputError: a name that leads out of the runs folder and the examples.
            FileFormatError: nothing of that name is there.
        """
        folder, name = self._folder(choice)
        return folder.path_of(name)

    def proposed_model(self, choice: str) -> str:
        """Return the shipped model that suits a recording, by its bench and rig; empty for none.

        A hinge has one model a rig; a sweep takes eq. (2) or (4) with the errors of a real bench, a
        table without a rig eq. (2).
        """
        path = self.path_of(choice)
        rig = load_rig_for_data([str(path)])
        hinge = "theta_rad" in (sample_names(path) if path.is_dir() else _names_of(path))
        if hinge:
            own = f"pitch_{rig.name}" if rig is not None else ""
            return own if own in model_names() else ""
        if rig is None:
            return "single"
        return "single_bench" if len(rig.rotors) == 1 else "quad_bench"

    def model_of(self, choice: str) -> str:
        """Return a model as the command takes it: a shipped name, or a path; checked as above."""
        return model_path(*self._folder(choice))

    def _folder(self, choice: str) -> tuple[RunsFolder, str]:
        if self.examples is not None and choice.startswith(EXAMPLE):
            return self.examples, choice.removeprefix(EXAMPLE)
        return self.runs, choice


def _names_of(file: Path) -> tuple[str, ...]:
    """Return the channels of a recording's file, or the columns of a table."""
    if metadata_path(file).is_file():
        channels = read_recording_facts(metadata_path(file), FORMAT)["channels"]
        return tuple(str(one["name"]) for one in channels)
    return read_csv_header(file)


def _recordings(entries: Iterable[Entry]) -> dict[str, str]:
    """Return what can be explained, name to words."""
    found = {}
    for entry in entries:
        if entry.kind in RECORDED and not entry.problem:
            about = ", ".join(filter(None, (entry.kind, entry.rig, entry.summary)))
            found[entry.name] = f"{entry.name} ({about})"
    return found


def _model_files(folder: RunsFolder) -> list[str]:
    """Return the names of model files in a folder and the folders in it; not of hidden ones, in
    which fits are still being written.
    """
    files = sorted((*folder.root.glob("[!.]*.toml"), *folder.root.glob("[!.]*/[!.]*.toml")))
    return [folder.name_of(file) for file in files if _is_model(file)]


def _is_model(file: Path) -> bool:
    if file.stat().st_size > MAX_TEXT_BYTES:
        return False
    try:
        head = parse_toml(read_text(file), file.name).get("model")
    except BenchtoolError:
        return False
    return isinstance(head, dict) and "rig" in head
