"""A run folder: created once, never written over, appended to while a sweep runs, then closed."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

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
from benchtool.core.resource_errors import is_exhaustion, resource_error
from benchtool.core.user_file import read_text
from benchtool.data.atomic import file_hash, make_folder, replace_json, replace_text, sync_folder
from benchtool.data.run.append import AppendFile, EventLog, SampleWriter
from benchtool.data.run.closing import (
    LEFTOVER_PATTERN,
    SampleScan,
    close_run,
    has_rows,
    remove_leftovers,
    scan_samples,
    write_marker,
)
from benchtool.data.run.points import PointWriter, write_table
from benchtool.data.run.read import changed_points, is_run
from benchtool.data.run.read import read_settings as read_written_settings
from benchtool.data.run.run_metadata import read_metadata
from benchtool.data.run.settings import load_settings

RUN_FORMAT = "benchtool-run-1"


class Run:
    """Own the files of one run folder.

    While a run is measured (`watch`), plan and metadata are in memory too, and nothing is written
    into another folder that came in place of the one that was opened.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._opened: os.stat_result | None = None
        self._plan_text = ""
        self._facts: dict[str, Any] = {}

    @classmethod
    def create(cls, path: Path, plan_text: str, metadata: Mapping[str, Any]) -> Run:
        """Make the folder with its plan and metadata.

        Raises:
            WouldOverwrite: something of that name exists.
            ResourceExhausted: there is no room or no right to make it; nothing is left of it.
        """
        check_not_existing(path)
        beside = path.with_name(f".{path.name}.{os.getpid()}.new")
        try:
            make_folder(path.parent)
            beside.mkdir()
            replace_text(beside / "plan.toml", plan_text)
            replace_json(beside / "metadata.json", {"format": RUN_FORMAT, **metadata})
            if path.is_dir():
                shutil.rmtree(path)
            os.rename(beside, path)
            sync_folder(path.parent)
        except OSError as error:
            shutil.rmtree(beside, ignore_errors=True)
            if error.errno == errno.ENOTEMPTY:
                raise WouldOverwrite(str(path)) from None
            subject = f"the run folder {path} cannot be made"
            if not is_exhaustion(error):
                raise InputError(
                    f"{subject} ({error.strerror}); choose another place with --out"
                ) from error
            raise resource_error(error, subject, "choose another place with --out") from error
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
        """The plan as it was when the run began."""
        return read_text(self.path / "plan.toml", follow=False)

    @property
    def metadata(self) -> dict[str, Any]:
        """The facts about the run."""
        return read_metadata(self.path)

    def update_metadata(self, **facts: Any) -> None:
        """Replace some facts; the file changes in one step."""
        if self._opened is None:
            replace_json(self.path / "metadata.json", {**self.metadata, **facts})
            return
        self._facts |= facts
        self.check_in_place()
        replace_json(self.path / "metadata.json", self._facts)

    def watch(self) -> None:
        """Remember which folder this is, and its plan and metadata, from now on."""
        self._plan_text, self._facts = self.plan_text, self.metadata
        self._opened = os.stat(self.path)

    def check_in_place(self) -> None:
        """Refuse a folder that is not the one that `watch` saw, or that may not be written.

        Raises:
            RunInterrupted: it was deleted, moved or replaced.
            ResourceExhausted: it was made read-only.
        """
        if self._opened is None:
            return
        try:
            there = os.stat(self.path)
        except (FileNotFoundError, NotADirectoryError):
            raise RunInterrupted(
                f"the run folder {self.path} is not there any more: it was deleted or moved"
            ) from None
        if not os.path.samestat(there, self._opened):
            raise RunInterrupted(
                f"the run folder {self.path} is not the one that this run opened: another one was "
                f"put in its place"
            )
        effective = os.access in os.supports_effective_ids
        if not os.access(self.path, os.W_OK | os.X_OK, effective_ids=effective):
            raise ResourceExhausted(f"the run folder {self.path} was made read-only")

    def save_as(
        self, path: Path, facts: Mapping[str, Any], files: Sequence[AppendFile], *, whole: bool
    ) -> None:
        """Write the run into a new folder, from memory and open files.

        A whole run is owned there from then on.

        Args:
            files: that grow while the run is measured.
            whole: with what they hold, not only what could not be written to them.

        Raises:
            OSError: there is no room either; nothing is left there.
        """
        path.mkdir()
        try:
            for file in files:
                file.copy_to(path / file.path.name, whole=whole)
            replace_text(path / "plan.toml", self._plan_text)
            replace_json(path / "metadata.json", {**self._facts, **facts})
        except BaseException:
            shutil.rmtree(path, ignore_errors=True)
            raise
        if whole:
            self.path, self._opened = path, None

    def sample_writer(self, channels: tuple[Channel, ...]) -> SampleWriter:
        """Open samples.csv for appending."""
        return SampleWriter(self.path / "samples.csv", channels)

    def point_writer(self, n_rotors: int) -> PointWriter:
        """Open points.csv for appending."""
        return PointWriter(self.path / "points.csv", n_rotors)

    def event_log(self) -> EventLog:
        """Open events.jsonl for appending."""
        return EventLog(self.path / "events.jsonl")

    def close(self, visits: int | None = None) -> bool:
        """Close the run and return whether anything was missing; see `closing.close_run`.

        Raises:
            ResourceExhausted: it cannot be written.
        """
        try:
            return close_run(self, visits)
        except (OSError, MemoryError) as error:
            raise resource_error(
                error, f"{self.path} cannot be closed", f"then: benchtool runs close {self.path}"
            ) from error

    def ready_samples(self, done: frozenset[int]) -> SampleScan:
        """Say what samples there are, and make ready to mark those of visits cut short.

        The run itself is as it was until a `RunWriter` goes on with it.

        Raises:
            InputError: another process measures or closes it.
            FileFormatError: its samples cannot be read.
            ResourceExhausted: it cannot be written.
        """
        samples = self.path / "samples.csv"
        try:
            with self.locked():
                remove_leftovers(self.path)
                if not os.path.lexists(samples):
                    return SampleScan(0, 0.0, done, None)
                found = scan_samples(samples, done)
                write_marker(samples, found)
                return found
        except (OSError, MemoryError) as error:
            raise resource_error(error, f"{self.path} cannot be gone on with") from error

    def unseal(self) -> None:
        """Take away what `close` made, before samples or points change."""
        for name in ("samples.parquet", "settings.csv"):
            (self.path / name).unlink(missing_ok=True)
        # The hash of points that were changed by hand stays, so that they never match it.
        keys = ("samples",) if changed_points(self.path) else ("samples", "points")
        if any(self.metadata.get(key) for key in keys):
            self.update_metadata(**{key: {} for key in keys})

    def write_points(self, points: Recording) -> None:
        """Write points.csv in one step and state its hash."""
        path = self.path / "points.csv"
        write_table(path, points)
        self.update_metadata(points={"csv_sha256": file_hash(path)})

    @contextmanager
    def locked(self) -> Iterator[EventLog]:
        """Keep other processes from measuring or closing the run; gives its event log.

        Raises:
            InputError: another one does so now.
        """
        log = self.event_log()
        try:
            yield log
        finally:
            log.close()


def check_not_existing(path: Path) -> None:
    """Refuse a path where something is, but for a run folder that was never begun.

    Raises:
        WouldOverwrite: something is there.
    """
    if os.path.lexists(path) and not _never_begun(path):
        raise WouldOverwrite(str(path))


def _never_begun(path: Path) -> bool:
    """Return whether a folder is empty or holds a run that has neither a sample nor a point."""
    if path.is_symlink() or not path.is_dir():
        return False
    names = {item.name for item in path.iterdir() if not LEFTOVER_PATTERN.fullmatch(item.name)}
    if names and not is_run(path):
        return False  # a plan that somebody wrote there is no run of ours
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
    """Return the settings of a run folder, which is closed first where it must be, or of any file.

    A run that is being measured, or that cannot be written, is left as it is.
    """
    folder = Path(path)
    if is_run(folder) and not (folder / "settings.csv").is_file():
        try:
            Run.open(folder).close()
        except BenchtoolError:
            return load_settings(folder)
    return read_written_settings(path)


def free_run_path(folder: Path, date: str, name: str) -> Path:
    """Return FOLDER/DATE-NAME, with -2, -3 and so on behind it while that is taken."""
    check_name("run", name, ascii_only=True)
    return free_path(folder / f"{date}-{name}")


def free_path(path: Path) -> Path:
    """Return a path, with -2, -3 and so on behind it while that is taken."""
    free, count = path, 1
    while os.path.lexists(free):
        count += 1
        free = path.with_name(f"{path.name}-{count}")
    return free
