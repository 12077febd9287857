"""Recordings and models for the Explain tab: runs folder, and examples of a source checkout."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from benchtool.core.errors import BenchtoolError, InputError
from benchtool.core.inputs import to_arguments, with_changes
from benchtool.core.toml_text import parse_toml
from benchtool.core.user_file import MAX_TEXT_BYTES, read_text
from benchtool.data.catalogue.index import list_entries
from benchtool.data.csv_text import read_csv_header
from benchtool.data.run.entry import SWEEPS, Entry
from benchtool.data.run.read import load_rig_for_data, sample_names
from benchtool.data.run.recording_file import FORMAT, metadata_path
from benchtool.data.run.run_metadata import read_recording_facts
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.explain.inputs import ExplainInputs
from benchtool.fit.data_rig import rig_for_data
from benchtool.physics.model_file import model_names
from benchtool.web.tabs.fit.model_choice import check_rig_choice, model_choices, model_path


def command_arguments(inputs: ExplainInputs, out: Path) -> list[str]:
    """Return the arguments of the equivalent `benchtool explain`."""
    return ["explain", *to_arguments(ExplainInputs, with_changes(replace(inputs, out=out)))]


def explain_inputs(
    sources: RecordingSources,
    learn: Sequence[str],
    check: Sequence[str],
    model: str,
    rig: str | None = None,
) -> ExplainInputs:
    """Return the inputs of `benchtool explain` for the selected choices."""
    if not learn:
        raise InputError(
            "no training recording is selected; select one, save one under Simulate, or record "
            "one under Bench"
        )
    if not check:
        raise InputError(
            "no validation recording is selected; select another recording of the same bench"
        )
    if common := set(learn) & set(check):
        raise InputError(
            f"{', '.join(sorted(common))} is selected for both training and validation; select "
            f"different recordings"
        )
    if not model:
        raise InputError("no model is selected; select the model that describes the recordings")
    inputs = ExplainInputs(
        recordings=tuple(str(sources.find_path(name)) for name in learn),
        check=tuple(str(sources.find_path(name)) for name in check),
        model=sources.find_model(model),
        rig=check_rig_choice(rig, sources.runs),
    )
    rig_for_data((*inputs.recordings, *inputs.check), inputs.model, inputs.rig)
    return inputs


def suggested_folder(sources: RecordingSources, learn: Sequence[str], date: str) -> Path:
    """Return a free folder for the result of some recordings."""
    first = Path(learn[0].rsplit("/", 1)[-1]).stem if learn else "recording"
    stem = re.sub(r"[^A-Za-z0-9_-]+", "-", first).strip("-_")[:40] or "recording"
    return sources.runs.free_path(date, f"explain-{stem}")


EXAMPLE_PREFIX = "example: "  # of recordings of a source checkout; no run name has a colon
RECORDING_KINDS = (*SWEEPS, "pitch recording", "recording", "table")


def examples_folder() -> Path | None:
    """Return the folder of example recordings of a source checkout, relative if possible."""
    folder = Path(__file__).parents[4] / "datasets"
    if not (folder / "pitch_friction").is_dir():
        return None
    cwd = Path.cwd()
    return folder.relative_to(cwd) if folder.is_relative_to(cwd) else folder


class RecordingChoices(NamedTuple):
    """Labels of recordings and models by choice."""

    recordings: dict[str, str]
    models: dict[str, str]


class RecordingSources(NamedTuple):
    """Folders of recordings and models; maps choices to paths inside them only."""

    runs: RunsFolder
    examples: RunsFolder | None = None

    @classmethod
    def from_folder(cls, root: Path) -> RecordingSources:
        examples = examples_folder()
        return cls(RunsFolder(root), RunsFolder(examples) if examples else None)

    def read_choices(self) -> RecordingChoices:
        """Read the available choices: newest run first, examples last."""
        entries = list_entries(self.runs)
        recordings = _recordings(entries)
        models = dict(model_choices(self.runs, entries))
        models |= {name: name for name in _model_files(self.runs) if name not in models}
        if self.examples is not None:
            examples = sorted(list_entries(self.examples), key=lambda entry: entry.name)
            recordings |= {
                EXAMPLE_PREFIX + name: EXAMPLE_PREFIX + label
                for name, label in _recordings(examples).items()
            }
            models |= {
                EXAMPLE_PREFIX + name: EXAMPLE_PREFIX + name for name in _model_files(self.examples)
            }
        return RecordingChoices(recordings=recordings, models=models)

    def find_path(self, choice: str) -> Path:
        """Return the path of a recording; raise if it is missing or outside the folders."""
        folder, name = self._folder(choice)
        return folder.find_path(name)

    def suggest_model(self, choice: str) -> str:
        """Return the library model for a recording's bench and rig, or "".

        A pitch hinge has one model per rig. A sweep gets eq. (2) or (4) with bench errors, a table
        without a rig eq. (2).
        """
        path = self.find_path(choice)
        rig = load_rig_for_data([str(path)])
        names = sample_names(path) if path.is_dir() else _channel_names(path)
        if "theta_rad" in names:
            model = f"pitch_{rig.name}" if rig is not None else ""
            return model if model in model_names() else ""
        if rig is None:
            return "single"
        return "single_bench" if len(rig.rotors) == 1 else "quad_bench"

    def find_model(self, choice: str) -> str:
        """Return a model as a library name or a path, checked as by `find_path`."""
        return model_path(*self._folder(choice))

    def _folder(self, choice: str) -> tuple[RunsFolder, str]:
        if self.examples is not None and choice.startswith(EXAMPLE_PREFIX):
            return self.examples, choice.removeprefix(EXAMPLE_PREFIX)
        return self.runs, choice


def _channel_names(file: Path) -> tuple[str, ...]:
    """Return the channels of a recording file or the columns of a table."""
    if metadata_path(file).is_file():
        channels = read_recording_facts(metadata_path(file), FORMAT)["channels"]
        return tuple(str(channel["name"]) for channel in channels)
    return read_csv_header(file)


def _recordings(entries: Iterable[Entry]) -> dict[str, str]:
    """Return the labels of explainable entries by name."""
    labels = {}
    for entry in entries:
        if entry.kind in RECORDING_KINDS and not entry.problem:
            details = ", ".join(filter(None, (entry.kind, entry.rig, entry.summary)))
            labels[entry.name] = f"{entry.name} ({details})"
    return labels


def _model_files(folder: RunsFolder) -> list[str]:
    """Return the names of model files in a folder and its subfolders, except hidden ones."""
    files = sorted((*folder.root.glob("[!.]*.toml"), *folder.root.glob("[!.]*/[!.]*.toml")))
    return [folder.relative_name(file) for file in files if _is_model(file)]


def _is_model(file: Path) -> bool:
    if file.stat().st_size > MAX_TEXT_BYTES:
        return False
    try:
        head = parse_toml(read_text(file), file.name).get("model")
    except BenchtoolError:
        return False
    return isinstance(head, dict) and "rig" in head
