"""Models, rigs and recordings to choose on the page: library, runs folder, and examples."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from benchtool.core.errors import BenchtoolError, InputError, UnknownChoice
from benchtool.core.rig_file import load_rig_by_name, rig_names
from benchtool.core.toml_text import parse_toml
from benchtool.core.user_code import check_code_allowed
from benchtool.core.user_file import MAX_TEXT_BYTES, read_text
from benchtool.data.catalogue.index import list_entries, load_entries
from benchtool.data.csv_text import read_csv_header
from benchtool.data.run.entry import SWEEPS, Entry
from benchtool.data.run.read import load_rig_for_data, sample_names
from benchtool.data.run.recording_file import metadata_path, read_recording_facts
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.physics.model_file import model_names


def model_choices(folder: RunsFolder, entries: Iterable[Entry]) -> dict[str, str]:
    """Return labels of library models and of models from fits and explanations, by name."""
    labels = {name: name for name in model_names()}
    for entry in entries:
        if entry.kind in ("fit", "explanation") and not entry.problem:
            name = f"{entry.name}/model.toml"
            if (folder.root / name).is_file():
                labels[name] = f"{entry.name} ({entry.rig}, from this {entry.kind})"
    return labels


def model_path(folder: RunsFolder, name: str) -> str:
    """Return the name of a library model, or the path of a model in the runs folder.

    InputError if the model file or its rig is outside the folder, or needs user code.
    """
    if name in model_names():
        return name
    path = folder.find_file(name)
    table = parse_toml(read_text(path), name).get("model", {})
    table = table if isinstance(table, dict) else {}
    parent = PurePosixPath(name).parent
    if table.get("effects_file"):
        check_code_allowed(f"{parent}/{table['effects_file']}")
    rig = str(table.get("rig", ""))
    if rig and rig not in rig_names():
        if PurePosixPath(rig).name != rig:
            raise InputError(
                f"rig {rig!r} of {name} is outside its folder, but the page reads the runs folder "
                f"only; use benchtool fit --model"
            )
        folder.find_file(f"{parent}/{rig}")
    return str(path)


def rig_choices(folder: RunsFolder) -> dict[str, str]:
    """Return labels of library rigs and of rig files in the runs folder, by name or path."""
    labels = {name: name for name in rig_names()}
    for path in sorted(folder.root.glob("*.toml")):
        try:
            file = folder.find_file(path.name)
            labels[str(file)] = f"{load_rig_by_name(file).name} ({path.name})"
        except InputError:
            continue  # another kind of file, or an invalid rig
    return labels


def check_rig_choice(name: str | None, folder: RunsFolder) -> str | None:
    """Return the name of a rig; raise if it is not a choice of the page."""
    if name is not None and name not in (choices := rig_choices(folder)):
        raise UnknownChoice("rig", name, choices)
    return name


EXAMPLE_PREFIX = "example: "  # of recordings of a source checkout; no run name has a colon
RECORDING_KINDS = (*SWEEPS, "pitch recording", "recording", "table")


class RecordingSources(NamedTuple):
    """Folders of recordings and models; maps choices to paths inside them only."""

    runs: RunsFolder
    examples: RunsFolder | None = None

    @classmethod
    def from_folder(cls, root: Path) -> RecordingSources:
        examples, cwd = Path(__file__).parents[2] / "datasets", Path.cwd()
        if not (examples / "pitch_friction").is_dir():  # no source checkout
            return cls(RunsFolder(root))
        examples = examples.relative_to(cwd) if examples.is_relative_to(cwd) else examples
        return cls(RunsFolder(root), RunsFolder(examples))

    def read_choices(self) -> tuple[dict[str, str], dict[str, str]]:
        """Return labels of recordings and of models by choice: newest run first, examples last."""
        entries = load_entries(self.runs.root)
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
        return recordings, models

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
        channels = read_recording_facts(file)["channels"]
        return tuple(str(channel["name"]) for channel in channels)
    return read_csv_header(file)


def _recordings(entries: Iterable[Entry]) -> dict[str, str]:
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
