"""Request of an explanation: recordings of one kind of bench, model, user-defined effects."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchtool.core.channel import ColumnSource
from benchtool.core.errors import FileFormatError, InputError, MissingColumn
from benchtool.core.recording import Recording
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.atomic import data_hash, file_hash
from benchtool.data.calibration import ZeroNoise
from benchtool.data.columns import VALID_KINDS
from benchtool.data.csv_text import read_csv_header
from benchtool.data.run.entry import detect_kind
from benchtool.data.run.read import changed_points, is_run, read_pitch, read_points, sample_names
from benchtool.data.run.recording_file import metadata_path, read_recording
from benchtool.data.table import read_table
from benchtool.explain.inputs import ExplainInputs
from benchtool.explain.result import Explanation
from benchtool.fit.nominal import rig_for_data
from benchtool.physics.catalogue import EFFECTS, user_effects
from benchtool.physics.effects.effect import BenchKind, Effect
from benchtool.physics.model_file import LoadedModel, load_model, model_names

# The methods of a request import the engine, which takes longer than a check of the inputs.
if TYPE_CHECKING:
    from benchtool.explain.engine.subject import Log, Subject

# Channel that identifies a bench, in order of precedence
IDENTIFIED_BY: dict[BenchKind, str] = {"pitch": "theta_rad", "sweep": "thrust_N"}
REQUIRED = ("time_s", "theta_rad", "thrust_N")  # by bench; other columns may be missing


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RecordingSource:
    """Recording with its provenance."""

    path: str  # as typed
    name: str  # display name: of the file or folder; the path if two are equal
    recording: Recording
    sha256: str  # of the data
    remarks: tuple[str, ...] = ()  # warnings, such as missing columns of the model's map
    zero: ZeroNoise | None = None  # of the load cell, if the run shows it; else the rig's


def read_sources(
    learn: Sequence[str], check: Sequence[str], loaded: LoadedModel
) -> tuple[list[RecordingSource], list[RecordingSource]]:
    """Return training and validation recordings.

    Raises:
        InputError: duplicate data, or two kinds of benches.
        FileFormatError: a file that is not a recording.
    """
    seen: dict[str, str] = {}
    for path in (*learn, *check):
        digest = data_hash(path)
        if digest in seen:
            raise InputError(
                f"{path} has the same data as {seen[digest]}; give each recording once, and "
                f"validation recordings that differ from the training recordings"
            )
        seen[digest] = path
    hashes = {path: digest for digest, path in seen.items()}
    short = [Path(path).name or path for path in hashes]
    names = {  # the path if two are equal
        path: name if short.count(name) == 1 else path
        for path, name in zip(hashes, short, strict=True)
    }
    groups = [
        [_without_constant(_read_source(path, names[path], hashes[path], loaded)) for path in part]
        for part in (learn, check)
    ]
    kinds = {bench_kind(source): source.path for part in groups for source in part}
    if len(kinds) > 1:
        raise InputError(
            f"mixed recordings: {kinds['pitch']} is from a pitch bench, {kinds['sweep']} from a "
            f"plate sweep; explain them separately"
        )
    return groups[0], groups[1]


def bench_kind(source: RecordingSource) -> BenchKind:
    """Return the kind of bench of a recording, from its channels."""
    for kind, channel in IDENTIFIED_BY.items():
        if channel in source.recording:
            return kind
    if "thrust_ratio" in source.recording:
        raise InputError(
            f"{source.path} has thrust ratios, but an explanation needs thrust_N; use benchtool "
            f"fit --compare laws for ratios"
        )
    raise InputError(
        f"{source.path} has neither theta_rad (pitch bench) nor thrust_N (plate sweep), only "
        f"{', '.join(source.recording.names)}; map its columns in the model's [columns]"
    )


def _read_source(path: str, name: str, digest: str, loaded: LoadedModel) -> RecordingSource:
    columns: Mapping[str, ColumnSource] = {}
    remarks: Sequence[str] = ()
    zero: ZeroNoise | None = None
    metadata = metadata_path(Path(path))
    if is_run(path):  # pitch experiment, or points of a sweep with its tares
        remarks = changed_points(path)
        if IDENTIFIED_BY["pitch"] in sample_names(path):
            recording = read_pitch(path)
        else:
            from benchtool.fit.uncertainty.load_cell import run_zero_noise

            recording, zero = read_points(path, VALID_KINDS), run_zero_noise(path, loaded.model.rig)
    elif metadata.is_file():
        recording = read_recording(path)
    elif Path(path).suffix.lower() == ".parquet":
        raise FileFormatError(path, f"{metadata.name} is missing; use benchtool import")
    else:
        columns, remarks = _select_columns(path, name, loaded.columns)
        filters = [f"{key}={value}" for key, value in loaded.row_filter.items()] if columns else []
        recording = read_table(path, columns, filters)
        if recording.provenance.get("repairs"):
            remarks = (*remarks, f"{name}: {recording.provenance['repairs']}")
    return RecordingSource(
        path=path, name=name, recording=recording, sha256=digest, remarks=tuple(remarks), zero=zero
    )


def _without_constant(source: RecordingSource) -> RecordingSource:
    """Return a source without constant rotor speeds, pulse widths and pitch rates, with warnings.

    A rotor speed with the same value in every row was not measured. A constant pulse width is
    valid if the speed of its rotor is constant, too.

    Raises:
        InputError: no pulse width changes, and no measured speed shows the excitation.
    """
    recording, remarks = source.recording, list(source.remarks)
    if IDENTIFIED_BY["pitch"] not in recording or len(recording) < 2:
        return source
    constant = {
        name: float(recording.column(name)[0])
        for name in recording.names
        if _VARIABLE.fullmatch(name) and np.ptp(recording.column(name)) == 0.0
    }
    pulses = [name for name in recording.names if name.startswith("pwm")]
    has_speed = any(name.startswith("rpm") and name not in constant for name in recording.names)
    if pulses and not has_speed and set(pulses) <= set(constant):
        raise InputError(
            f"{pulses[0]} of {source.name} is {constant[pulses[0]]:g} in every row, as are all "
            f"pulse widths, and no rotor speed changes: no excitation of the beam; record rpm as "
            f"well, with steps of attitude and collective, as in the schedule identify"
        )
    dead = [n for n in constant if not n.startswith("pwm") or _changed_speed(recording, n)]
    for name, value in constant.items():
        effect = ": dead channel, not used; repair it" if name in dead else ", accepted as constant"
        remarks.append(f"{source.name}: {name} is {value:g} in every row{effect}")
    return replace(source, recording=recording.drop(dead), remarks=tuple(remarks))


_VARIABLE = re.compile(r"rpm\d+|pwm\d+_us|gyro_rad_s")  # channels that change if connected
MAX_STEADY_RANGE = 0.05  # of the mean speed at a constant pulse width; assumed


def _changed_speed(recording: Recording, pulse: str) -> bool:
    """Return True if a rotor changed its speed at constant pulse width.

    The lowest and highest twentieth of the speeds are ignored: the rotor may still accelerate.
    """
    name = pulse.replace("pwm", "rpm").removesuffix("_us")
    if name not in recording:
        return False
    speeds = recording.column(name)[np.isfinite(recording.column(name))]
    if len(speeds) < 2:
        return False
    low, high = np.quantile(speeds, [0.05, 0.95])
    return bool(high - low > MAX_STEADY_RANGE * np.abs(np.mean(speeds)))


def _select_columns(
    path: str, name: str, columns: Mapping[str, ColumnSource]
) -> tuple[Mapping[str, ColumnSource], list[str]]:
    """Return the map without columns that are missing in a file, and warnings about them.

    A file with standard names needs no map. If a required column is missing, the map is returned
    unchanged, so that reading the file raises an error with its columns.
    """
    if not columns:
        return {}, []
    header = read_csv_header(Path(path))
    missing = {
        channel: source.column
        for channel, source in columns.items()
        if source.column is not None and source.column.strip() not in header
    }
    if any(channel in missing for channel in REQUIRED):
        has_standard_names = any(channel in header for channel in REQUIRED)
        return {} if has_standard_names else columns, []
    return {key: source for key, source in columns.items() if key not in missing}, [
        f"{name}: no column {column!r}, which the model's [columns] map to {channel}"
        for channel, column in missing.items()
    ]


MAX_LISTED = 6  # recordings of a folder in a message; assumed

OTHERS = {  # files next to recordings, by suffix
    ".toml": "a TOML file (use --model for a model)",
    ".json": "a JSON file",
    ".html": "a page",
    ".svg": "a picture",
    ".png": "a picture",
    ".txt": "a text file",
}
RECORDING_HINT = "a recording is a CSV file, a Parquet file with its JSON, or a run folder"


def find_path_error(path: str) -> InputError | None:
    """Return an error if a path cannot be a recording, else None."""
    file = Path(path)
    if not file.exists():
        return FileFormatError(path, "no such run or file; check the path")
    if file.is_dir():
        return None if is_run(file) else FileFormatError(path, _describe_folder(file))
    if file.suffix.lower() in OTHERS:
        return FileFormatError(path, f"this is {OTHERS[file.suffix.lower()]}; {RECORDING_HINT}")
    return None


def list_recordings(folder: Path) -> list[Path]:
    """Return the recordings of a folder, else its tables, else those of its subfolders."""
    for pattern in ("*", "*/*"):
        paths = [item for item in sorted(folder.glob(pattern)) if not item.name.startswith(".")]
        kinds = {item: detect_kind(item) for item in paths}
        for accepted in (("recording", "sweep"), ("table",)):
            listed = [
                item
                for item, kind in kinds.items()
                if kind in accepted and (kind != "sweep" or is_run(item))
            ]
            if listed:
                return listed
    return []


def _describe_folder(folder: Path) -> str:
    paths = list_recordings(folder)
    if not paths:
        return f"this folder is not a run and contains no recording; {RECORDING_HINT}"
    names = ", ".join(str(item) for item in paths[:MAX_LISTED])
    omitted = f" and {len(paths) - MAX_LISTED} more" if len(paths) > MAX_LISTED else ""
    return f"this folder is not a run; use recordings in it: {names}{omitted}"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Request:
    """Recordings, model and user-defined effects, all read."""

    inputs: ExplainInputs  # as typed
    loaded: LoadedModel
    model_file: str  # name in the library or name of the model file
    model_sha256: str  # of the model file; empty for a library model
    effects_file: Path | None  # Python file of user-defined effects
    user_effects: tuple[Effect, ...]  # user-defined effects
    learn: tuple[RecordingSource, ...]
    check: tuple[RecordingSource, ...]

    @property
    def sources(self) -> tuple[RecordingSource, ...]:
        """All recordings."""
        return (*self.learn, *self.check)

    @property
    def kind(self) -> BenchKind:
        """Bench of the recordings."""
        return bench_kind(self.learn[0])

    @property
    def effects(self) -> dict[str, Effect]:
        """All effects by name: those of the library, and user-defined ones."""
        return {**EFFECTS, **{effect.name: effect for effect in self.user_effects}}

    @property
    def hashes(self) -> Mapping[str, str]:
        """SHA-256 of each recording by its name."""
        return {source.name: source.sha256 for source in self.sources}

    def subject(self) -> Subject:
        """Return the recordings with the model; InputError if they are insufficient."""
        from benchtool.explain.pitch.subject import PitchSubject
        from benchtool.explain.sweep.subject import SweepSubject

        effects = [effect for effect in self.user_effects if self.kind in effect.benches]
        learn, check = ([self._log(source) for source in part] for part in (self.learn, self.check))
        subject_class: type[Subject] = SweepSubject if self.kind == "sweep" else PitchSubject
        return subject_class(self.loaded.model, learn, check, effects)

    def _log(self, source: RecordingSource) -> Log:
        from benchtool.explain.pitch.log import pitch_log
        from benchtool.explain.sweep.log import sweep_log

        rig = self.loaded.model.rig
        if self.kind == "sweep":
            return sweep_log(source.recording, rig, zero=source.zero)
        return pitch_log(source.recording, rig, source.name, self.loaded.plate_slide_s)

    def explain(self, commands: Sequence[str] = (), **options: Any) -> Explanation:
        """Explain the recordings; options as of the engine's `explain`."""
        from benchtool.explain.engine.explain import explain

        found = explain(self.subject(), self.inputs, **options)
        remarks = [line for source in self.sources for line in source.remarks]
        return replace(
            found,
            remarks=tuple(dict.fromkeys((*remarks, *found.remarks))),
            source=self,
            commands=tuple(commands),
        )


def read_request(inputs: ExplainInputs, permit: CodePermit = check_code_allowed) -> Request:
    """Read recordings, model and user-defined effects; report all missing inputs together."""
    learn, check, model, effects = inputs.recordings, inputs.check, inputs.model, inputs.effects
    if not learn:
        order = " (all arguments after --check are validation recordings)" if check else ""
        example = "benchtool explain learn.csv --model model.toml --check check.csv"
        raise InputError(f"no training recordings{order}; example: {example}")
    errors = [error for path in (*learn, *check) if (error := find_path_error(path)) is not None]
    loaded: LoadedModel | None = None
    user_defined: tuple[Effect, ...] = ()
    try:
        if not model:
            names = [name for name in model_names() if not name.startswith("virtual_")]
            raise InputError(
                f"no model; use --model with the path of a model file or one of: {', '.join(names)}"
            )
        readable = () if errors else (*learn, *check)
        loaded = load_model(model, rig_for_data(readable, model, inputs.rig), permit=permit)
    except InputError as error:
        errors.append(error)
    try:
        user_defined = user_effects(effects, permit) if effects else ()
    except InputError as error:
        errors.append(error)
    if not check:
        errors.append(InputError("no validation recording of the same bench; use --check FILE"))
    if errors or loaded is None:
        if len(errors) == 1:
            raise errors[0]
        listed = " ".join(f"({number}) {error}." for number, error in enumerate(errors, 1))
        raise InputError(f"{len(errors)} problems: {listed.removesuffix('.')}")
    file = Path(model) if Path(model).suffix == ".toml" and Path(model).is_file() else None
    effects_path = Path(effects) if effects and effects.endswith(".py") else None
    if effects_path is None and loaded.effects_file and file is not None:
        effects_path = file.parent / loaded.effects_file
    try:
        sources, checks = read_sources(learn, check, loaded)
    except MissingColumn as error:
        raise error.with_map_file(file.name if file is not None else model) from None
    return Request(
        inputs=inputs,
        loaded=loaded,
        model_file=file.name if file is not None else model,
        model_sha256=file_hash(file) if file is not None else "",
        effects_file=effects_path,
        user_effects=user_defined,
        learn=tuple(sources),
        check=tuple(checks),
    )
