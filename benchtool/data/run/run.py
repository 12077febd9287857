"""Run folder: created once, never overwritten, appended to during a sweep, then closed."""

from __future__ import annotations

import errno
import os
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchtool.core.channel import Channel
from benchtool.core.errors import (
    BenchtoolError,
    FileFormatError,
    InputError,
    ResourceExhausted,
    RunInterrupted,
    WouldOverwrite,
    check_name,
)
from benchtool.core.recording import Recording
from benchtool.core.text import pluralize
from benchtool.core.user_file import is_exhaustion, read_text, resource_error
from benchtool.data.atomic import file_hash, make_folder, replace_json, replace_text, sync_folder
from benchtool.data.columns import VALID_KINDS, word_to_code
from benchtool.data.parquet import finalize_parquet, scan_lines
from benchtool.data.run.append import (
    AppendFile,
    Event,
    EventLog,
    SampleScan,
    SampleWriter,
    read_events,
    write_marked_samples,
)
from benchtool.data.run.points import PointWriter, load_settings, write_table
from benchtool.data.run.read import changed_points, is_run, read_own_recording, read_points
from benchtool.data.run.run_metadata import read_metadata

RUN_FORMAT = "benchtool-run-1"

ENDED_UNEXPECTEDLY = "the program that measured it ended unexpectedly (killed, or the power failed)"

LEFTOVER_PATTERN = re.compile(r"\.[^/]+\.new")  # temporary files of a killed writer


class Run:
    """Run folder and its files.

    After `watch`, plan and metadata are in memory too, and writing raises an error if the folder
    was replaced.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._watched_status: os.stat_result | None = None
        self._plan_text = ""
        self._metadata: dict[str, Any] = {}

    @classmethod
    def create(cls, path: Path, plan_text: str, metadata: Mapping[str, Any]) -> Run:
        """Create the folder with its plan and metadata.

        Raises:
            WouldOverwrite: the path exists.
            ResourceExhausted: no space or no permission; nothing is left behind.
        """
        check_not_existing(path)
        new_path = path.with_name(f".{path.name}.{os.getpid()}.new")
        try:
            make_folder(path.parent)
            new_path.mkdir()
            replace_text(new_path / "plan.toml", plan_text)
            replace_json(new_path / "metadata.json", {"format": RUN_FORMAT, **metadata})
            if path.is_dir():
                shutil.rmtree(path)
            os.rename(new_path, path)
            sync_folder(path.parent)
        except OSError as error:
            shutil.rmtree(new_path, ignore_errors=True)
            if error.errno == errno.ENOTEMPTY:
                raise WouldOverwrite(str(path)) from None
            problem, remedy = f"the run folder {path} cannot be made", "use another path for --out"
            if not is_exhaustion(error):
                raise InputError(f"{problem} ({error.strerror}); {remedy}") from error
            raise resource_error(error, problem, remedy) from error
        return cls(path)

    @classmethod
    def open(cls, path: Path) -> Run:
        """Return the run in an existing folder."""
        if not path.exists():
            raise FileFormatError(str(path), "there is no such run; check the path")
        if not is_run(path):
            raise FileFormatError(str(path), "there is no metadata.json in it; name a run folder")
        return cls(path)

    @property
    def plan_text(self) -> str:
        """Plan at the start of the run."""
        return read_text(self.path / "plan.toml", follow=False)

    @property
    def metadata(self) -> dict[str, Any]:
        """Contents of metadata.json."""
        return read_metadata(self.path)

    def update_metadata(self, **facts: Any) -> None:
        """Replace keys of metadata.json; the file is written atomically."""
        if self._watched_status is None:
            replace_json(self.path / "metadata.json", {**self.metadata, **facts})
            return
        self._metadata |= facts
        self.check_in_place()
        replace_json(self.path / "metadata.json", self._metadata)

    def watch(self) -> None:
        """Store the identity of the folder, its plan and its metadata in memory."""
        self._plan_text, self._metadata = self.plan_text, self.metadata
        self._watched_status = os.stat(self.path)

    def check_in_place(self) -> None:
        """Raise if the folder is not the one of `watch` or is read-only; no-op before `watch`.

        Raises:
            RunInterrupted: it was deleted, moved or replaced.
            ResourceExhausted: it was made read-only.
        """
        if self._watched_status is None:
            return
        try:
            status = os.stat(self.path)
        except (FileNotFoundError, NotADirectoryError):
            raise RunInterrupted(
                f"the run folder {self.path} is missing: it was deleted or moved"
            ) from None
        if not os.path.samestat(status, self._watched_status):
            raise RunInterrupted(f"the run folder {self.path} was replaced by another folder")
        effective = os.access in os.supports_effective_ids
        if not os.access(self.path, os.W_OK | os.X_OK, effective_ids=effective):
            raise ResourceExhausted(f"the run folder {self.path} was made read-only")

    def save_as(
        self, path: Path, facts: Mapping[str, Any], files: Sequence[AppendFile], *, whole: bool
    ) -> None:
        """Write the run to a new folder, with its open files and changed keys of metadata.json.

        `whole` writes the whole contents of the files, and makes the new folder the run's path;
        else only the unwritten data are written. OSError without space: the folder is removed.
        """
        path.mkdir()
        try:
            for file in files:
                file.copy_to(path / file.path.name, whole=whole)
            replace_text(path / "plan.toml", self._plan_text)
            replace_json(path / "metadata.json", {**self._metadata, **facts})
        except BaseException:
            shutil.rmtree(path, ignore_errors=True)
            raise
        if whole:
            self.path, self._watched_status = path, None

    def sample_writer(self, channels: tuple[Channel, ...]) -> SampleWriter:
        """Open samples.csv for appending."""
        return SampleWriter(self.path / "samples.csv", channels)

    def point_writer(self, n_rotors: int) -> PointWriter:
        """Open points.csv for appending."""
        return PointWriter(self.path / "points.csv", n_rotors)

    def event_log(self) -> EventLog:
        """Open events.jsonl for appending."""
        return EventLog(self.path / "events.jsonl")

    def close(self, n_planned: int | None = None) -> bool:
        """Write the files and metadata of a closed run; return whether anything was missing.

        The state becomes `ended` if every point is measured, else `stopped` after an unexpected
        exit. settings.csv is derived from points.csv, samples.parquet in batches from samples.csv.
        Every step is idempotent, so closing can be killed at any time and repeated.

        Args:
            n_planned: number of points in the plan; default: from the metadata.

        Raises:
            InputError: another process measures or closes the run.
            FileFormatError: a file of the run cannot be read.
            ResourceExhausted: the run cannot be written.
        """
        missing = False
        try:
            self.check_in_place()
            with self.locked() as log:
                remove_leftovers(self.path)
                before = self.metadata
                n_measured = _count_measured(self.path)
                changes = _final_state(before, n_planned, n_measured, log)
                if n_measured:
                    settings = self.path / "settings.csv"
                    missing = not settings.is_file()
                    write_table(settings, load_settings(self.path))
                changes |= _seal(self.path, before)
                points = self.path / "points.csv"
                unsealed = missing or changes or not before.get("samples")
                if unsealed and not before.get("points") and has_rows(points):
                    changes["points"] = {"csv_sha256": file_hash(points, follow=False)}
                if changes:
                    self.update_metadata(**changes)
        except (OSError, MemoryError) as error:
            raise resource_error(
                error, f"{self.path} cannot be closed", f"then: benchtool runs close {self.path}"
            ) from error
        return missing or bool(changes)

    def prepare_samples(self, measured: frozenset[int]) -> SampleScan:
        """Scan the samples and prepare a copy in which interrupted points are marked.

        A `RunWriter` installs the copy when it resumes the run; until then nothing changes.
        """
        samples = self.path / "samples.csv"
        try:
            with self.locked():
                remove_leftovers(self.path)
                if not os.path.lexists(samples):
                    return SampleScan(0, 0.0)
                return write_marked_samples(samples, measured)
        except (OSError, MemoryError) as error:
            raise resource_error(error, f"{self.path} cannot be resumed") from error

    def unseal(self) -> None:
        """Remove derived files and hashes before samples or points change."""
        for name in ("samples.parquet", "settings.csv"):
            (self.path / name).unlink(missing_ok=True)
        # Manually edited points keep their old hash, so they never match it.
        keys = ("samples",) if changed_points(self.path) else ("samples", "points")
        if any(self.metadata.get(key) for key in keys):
            self.update_metadata(**{key: {} for key in keys})

    def write_points(self, points: Recording) -> None:
        """Write points.csv atomically and store its hash."""
        path = self.path / "points.csv"
        write_table(path, points)
        self.update_metadata(points={"csv_sha256": file_hash(path)})

    @contextmanager
    def locked(self) -> Iterator[EventLog]:
        """Lock the run against other processes that measure or close it; yield its event log."""
        log = self.event_log()
        try:
            yield log
        finally:
            log.close()


def remove_leftovers(folder: Path) -> None:
    """Remove temporary files of a killed process."""
    for path in folder.iterdir():
        if LEFTOVER_PATTERN.fullmatch(path.name) and not path.is_dir():
            path.unlink()


def _final_state(
    metadata: dict[str, Any], n_planned: int | None, n_measured: int, log: EventLog
) -> dict[str, Any]:
    """Return the changes of state and reason in the metadata; log them as an event."""
    state, planned = metadata.get("state"), n_planned or metadata.get("visits")
    if state not in ("running", "stopped"):
        return {}
    if planned and n_measured >= int(planned):
        text = f"closed afterwards; all is measured: {pluralize(n_measured, 'visit')}"
        changes: dict[str, Any] = {"state": "ended"}
    elif state == "running":
        text = f"closed afterwards; {ENDED_UNEXPECTEDLY}"
        changes = {"state": "stopped", "reason": ENDED_UNEXPECTEDLY}
    else:
        return {}
    events = read_events(log.path)
    if not events or events[-1].text != text:
        log.append(Event(events[-1].time_s if events else 0.0, "closed", text))
    return changes


def _count_measured(folder: Path) -> int:
    if not has_rows(folder / "points.csv"):
        return 0
    points = read_points(folder, VALID_KINDS)
    measured = points.column("kind") != word_to_code("kind", "tare")
    return len(np.unique(points.column("point")[measured]))


def _seal(folder: Path, metadata: dict[str, Any]) -> dict[str, Any]:
    """Write samples.parquet unless it is up to date; return its new hashes, {} if unchanged."""
    csv, parquet = folder / "samples.csv", folder / "samples.parquet"
    if not has_rows(csv):
        return {}
    hashes, csv_hash = metadata.get("samples") or {}, file_hash(csv, follow=False)
    if (
        hashes.get("csv_sha256") == csv_hash
        and parquet.is_file()
        and hashes.get("parquet_sha256") == file_hash(parquet, follow=False)
    ):
        return {}
    finalize_parquet(csv, parquet, csv_hash)
    return {"samples": {"parquet_sha256": file_hash(parquet), "csv_sha256": csv_hash}}


def has_rows(path: Path) -> bool:
    """Return whether a table has a complete row below its header."""
    return path.is_file() and scan_lines(path)[0] > 0


def check_not_existing(path: Path) -> None:
    """Raise if a path exists, unless it is an empty folder or a run without samples and points."""
    if os.path.lexists(path) and not _has_no_data(path):
        raise WouldOverwrite(str(path))


def _has_no_data(path: Path) -> bool:
    """Return whether a folder is empty or an unlocked run without samples and points."""
    if path.is_symlink() or not path.is_dir():
        return False
    names = {item.name for item in path.iterdir() if not LEFTOVER_PATTERN.fullmatch(item.name)}
    if names and not is_run(path):
        return False  # for example a user's plan
    if not names <= {"plan.toml", "metadata.json", "events.jsonl", "samples.csv", "points.csv"}:
        return False
    if any(has_rows(path / name) for name in ("samples.csv", "points.csv")):
        return False
    if "events.jsonl" not in names:
        return True
    try:
        with Run(path).locked():
            return True
    except InputError:
        return False


def read_settings(path: str | Path) -> Recording:
    """Return the settings of a file or a run folder; close the run first if necessary.

    A run that is being measured or is not writable stays unchanged.
    """
    folder = Path(path)
    if is_run(folder) and not (folder / "settings.csv").is_file():
        try:
            Run.open(folder).close()
        except BenchtoolError:
            return load_settings(folder)
    return read_own_recording(path, "settings.csv")


def free_run_path(folder: Path, date: str, name: str) -> Path:
    """Return FOLDER/DATE-NAME, with suffix -2, -3, ... if that path exists."""
    check_name("run", name, ascii_only=True)
    return free_path(folder / f"{date}-{name}")


def free_path(path: Path) -> Path:
    """Return a path, with suffix -2, -3, ... if it exists."""
    free, count = path, 1
    while os.path.lexists(free):
        count += 1
        free = path.with_name(f"{path.name}-{count}")
    return free
