"""Recordings of an explanation, in any supported format, and their kind of bench."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchtool.core.column_source import ColumnSource
from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.recording import Recording
from benchtool.data.atomic import data_hash
from benchtool.data.columns import VALID_KINDS
from benchtool.data.csv_text import read_csv_header
from benchtool.data.run.entry import kind_of
from benchtool.data.run.read import changed_points, is_run, read_pitch, read_points, sample_names
from benchtool.data.run.recording_file import metadata_path, read_recording
from benchtool.data.table import read_table
from benchtool.fit.uncertainty.zero_drift import add_zero_drift
from benchtool.physics.effects.effect import BenchKind
from benchtool.physics.model_file import LoadedModel

IDENTIFIED_BY: dict[BenchKind, str] = {"pitch": "theta_rad", "sweep": "thrust_N"}
"""The channel that identifies a bench; a hinge goes before a load cell."""

NEEDED: dict[BenchKind, tuple[str, ...]] = {
    "pitch": ("time_s", "theta_rad"),
    "sweep": ("thrust_N",),
}
"""Channels whose column must be in a file; others may be missing, with a remark."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RecordingSource:
    """Recording with its provenance."""

    path: str  # as the user gave it
    name: str  # for people: the file's or folder's own, the path where two share that
    recording: Recording
    sha256: str  # of its bytes
    remarks: tuple[str, ...] = ()  # columns of the model's map that the file has not

    @property
    def simulated(self) -> bool:
        """True if the recording is simulated."""
        return self.recording.simulated


def read_sources(
    learn: Sequence[str], check: Sequence[str], loaded: LoadedModel
) -> tuple[list[RecordingSource], list[RecordingSource]]:
    """Return the recordings to learn from and those to check on.

    Raises:
        InputError: none of either, the same data twice, or benches of two kinds.
        FileFormatError: a file that is no recording.
    """
    if missing := missing_channels(learn, check):
        raise missing[0]
    for path in (*learn, *check):
        if (wrong := unreadable(path)) is not None:
            raise wrong
    seen: dict[str, str] = {}
    for path in (*learn, *check):
        digest = data_hash(path)
        if digest in seen:
            raise InputError(
                f"{path} holds the same data as {seen[digest]}; a model is checked on what it did "
                f"not learn from, so name each recording once and check on another"
            )
        seen[digest] = path
    hashes = {path: digest for digest, path in seen.items()}
    names = recording_names(tuple(hashes))
    groups = [
        [_alive(_source(path, names[path], hashes[path], loaded)) for path in part]
        for part in (learn, check)
    ]
    kinds = {bench_kind(source): source.path for part in groups for source in part}
    if len(kinds) > 1:
        raise InputError(
            f"{kinds['pitch']} is of a pitch bench and {kinds['sweep']} of a plate sweep; explain "
            f"them one kind at a time"
        )
    return groups[0], groups[1]


def recording_names(paths: Sequence[str]) -> dict[str, str]:
    """Return a name for each recording, all different: its path only where two share the name."""
    short = [Path(path).name or path for path in paths]
    return {
        path: name if short.count(name) == 1 else path
        for path, name in zip(paths, short, strict=True)
    }


def missing_channels(learn: Sequence[str], check: Sequence[str]) -> list[InputError]:
    """Return errors for a request without anything to learn from, or to check on."""
    if not learn:
        order = " (every word behind --check is to check on)" if check else ""
        return [
            InputError(
                f"nothing to explain: give recordings to learn from{order}, for example benchtool "
                f"explain learn.csv --model model.toml --check check.csv"
            )
        ]
    if not check:
        return [
            InputError(
                "there is no check recording; name one of the same bench that is not learned "
                "from: --check FILE"
            )
        ]
    return []


def bench_kind(source: RecordingSource) -> BenchKind:
    """Return which kind of bench made a recording, by its channels."""
    for kind, channel in IDENTIFIED_BY.items():
        if channel in source.recording:
            return kind
    if "thrust_ratio" in source.recording:
        raise InputError(
            f"{source.path} has ratios of thrust, and an explanation takes thrust_N; compare laws "
            f"on ratios with benchtool fit --compare laws"
        )
    raise InputError(
        f"{source.path} has neither theta_rad (a pitch bench) nor thrust_N (a plate sweep), only "
        f"{', '.join(source.recording.names)}; map its columns in the model's [columns]"
    )


def _source(path: str, name: str, digest: str, loaded: LoadedModel) -> RecordingSource:
    if is_run(path):  # the experiment of a hinge, or the points of a sweep with its tares
        hinge = IDENTIFIED_BY["pitch"] in sample_names(path)
        if hinge:
            run = read_pitch(path)
        else:
            run = add_zero_drift(read_points(path, VALID_KINDS), path, loaded.model.rig)
        return RecordingSource(
            path=path, name=name, recording=run, sha256=digest, remarks=changed_points(path)
        )
    if metadata_path(Path(path)).is_file():
        return RecordingSource(path=path, name=name, recording=read_recording(path), sha256=digest)
    if Path(path).suffix.lower() == ".parquet":
        raise FileFormatError(
            path,
            f"there is no {metadata_path(Path(path)).name} beside it; import it with benchtool",
        )
    columns, remarks = _present(path, name, loaded.columns)
    filters = [f"{key}={value}" for key, value in loaded.row_filter.items()] if columns else []
    recording = read_table(path, columns, filters)
    if recording.provenance.get("repairs"):
        remarks.append(f"{name}: {recording.provenance['repairs']}")
    return RecordingSource(
        path=path, name=name, recording=recording, sha256=digest, remarks=tuple(remarks)
    )


def _alive(source: RecordingSource) -> RecordingSource:
    """Return a source without speeds, pulses and a gyro that never change, and say so.

    A rotor speed of exactly the same value in every row was never measured; a model held against
    it would be found wanting. A pulse may stand still, where its rotor does not change either.

    Raises:
        InputError: no pulse ever changes and no speed shows what drove the beam.
    """
    recording, remarks = source.recording, list(source.remarks)
    if IDENTIFIED_BY["pitch"] not in recording or len(recording) < 2:
        return source
    still = [
        name
        for name in recording.names
        if _DIES.fullmatch(name) and np.ptp(recording.column(name)) == 0.0
    ]
    alive = [name for name in recording.names if name not in still]
    speeds = [name for name in alive if name.startswith("rpm")]
    pulses = [name for name in recording.names if name.startswith("pwm")]
    if pulses and not speeds and set(pulses) <= set(still):
        value = recording.column(pulses[0])[0]
        raise InputError(
            f"{pulses[0]} of {source.name} is {value:g} in every row, as are all pulses, and no "
            f"rotor's speed changes: nothing drove the beam that could be followed; record rpm as "
            f"well, with steps of attitude and collective, as the schedule identify has them"
        )
    dead = [name for name in still if not name.startswith("pwm") or _changed_speed(recording, name)]
    for name in still:
        value = recording.column(name)[0]
        remarks.append(
            f"{source.name}: {name} is {value:g} in every row: a dead channel, left out; mend it"
            if name in dead
            else f"{source.name}: {name} is {value:g} in every row, which is taken for true"
        )
    columns = [
        (recording.channels[recording.index(name)], recording.column(name))
        for name in recording.names
        if name not in dead
    ]
    living = Recording.from_columns(columns, recording.provenance, recording.simulated)
    return replace(source, recording=living, remarks=tuple(remarks))


_DIES = re.compile(r"rpm\d+|pwm\d+_us|gyro_rad_s")

STEADY = 0.05  # share of a speed that changed: other pulses than one; assumed


def _changed_speed(recording: Recording, pulse: str) -> bool:
    """Return whether a rotor changed its speed at constant pulse width.

    The first and the last twentieth do not count: a rotor may still follow what came before.
    """
    name = pulse.replace("pwm", "rpm").removesuffix("_us")
    if name not in recording:
        return False
    speeds = recording.column(name)[np.isfinite(recording.column(name))]
    if len(speeds) < 2:
        return False
    low, high = np.quantile(speeds, [0.05, 0.95])
    return bool(high - low > STEADY * np.abs(np.mean(speeds)))


def _present(
    path: str, name: str, columns: Mapping[str, ColumnSource]
) -> tuple[Mapping[str, ColumnSource], list[str]]:
    """Return the map without columns that a file has not, and what is missing.

    A file with our own names needs no map. Where a needed column is missing, the map is left whole:
    reading it then says what the file has.
    """
    if not columns:
        return {}, []
    header = read_csv_header(Path(path))
    absent = {
        ours: source.column
        for ours, source in columns.items()
        if source.column is not None and source.column.strip() not in header
    }
    needed = [ours for names in NEEDED.values() for ours in names if ours in absent]
    has_standard_names = any(ours in header for names in NEEDED.values() for ours in names)
    if needed and has_standard_names:
        return {}, []
    if needed:
        return columns, []
    return (
        {ours: source for ours, source in columns.items() if ours not in absent},
        [
            f"{name}: no column {theirs!r}, which the model's [columns] map to {ours}"
            for ours, theirs in absent.items()
        ],
    )


MAX_LISTED = 6  # recordings of a folder in a message; assumed

OTHERS = {  # what files that stand beside recordings are by their names
    ".toml": "a TOML file (a model goes behind --model)",
    ".json": "a JSON file",
    ".html": "a page",
    ".svg": "a picture",
    ".png": "a picture",
    ".txt": "a text file",
}

READ_CHANNELS = "a recording is a CSV, a Parquet file with its JSON, or a run folder"


def unreadable(path: str) -> InputError | None:
    """Return why a path can be no recording; None where one may be."""
    file = Path(path)
    if not file.exists():
        return FileFormatError(path, "there is no such run or file; check the path")
    if file.is_dir():
        return None if is_run(file) else FileFormatError(path, _of_folder(file))
    if file.suffix.lower() in OTHERS:
        return FileFormatError(path, f"this is {OTHERS[file.suffix.lower()]}; {READ_CHANNELS}")
    return None


def list_recordings(folder: Path) -> list[Path]:
    """Return the recordings of a folder, else those of the folders in it.

    Tables that nothing says more of count where there is nothing better.
    """
    for pattern in ("*", "*/*"):
        paths = [item for item in sorted(folder.glob(pattern)) if not item.name.startswith(".")]
        kinds = {item: kind_of(item) for item in paths}
        for accepted in (("recording", "sweep"), ("table",)):
            listed = [
                item
                for item, kind in kinds.items()
                if kind in accepted and (kind != "sweep" or is_run(item))
            ]
            if listed:
                return listed
    return []


def _of_folder(folder: Path) -> str:
    paths = list_recordings(folder)
    if not paths:
        return f"this folder is no run, and no recording is in it; {READ_CHANNELS}"
    named = ", ".join(str(item) for item in paths[:MAX_LISTED])
    more = f" and {len(paths) - MAX_LISTED} more" if len(paths) > MAX_LISTED else ""
    if len(paths) == 1:
        return f"this folder is no run; name the recording in it: {named}"
    return f"this folder is no run; name one or more of the recordings in it: {named}{more}"
