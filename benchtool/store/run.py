"""A run folder: created once, never written over, appended to while a sweep runs, then closed."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchtool.core.channel import Channel
from benchtool.core.user_file import read_text
from benchtool.errors import (
    FileFormatError,
    InputError,
    ResourceExhausted,
    RunStopped,
    WouldOverwrite,
)
from benchtool.store.append import AppendFile
from benchtool.store.atomic import read_json, replace_json, replace_text
from benchtool.store.digest import file_hash
from benchtool.store.events import EventLog
from benchtool.store.parquet import seal
from benchtool.store.points import PointWriter
from benchtool.store.read import is_run, read_points
from benchtool.store.samples import SampleWriter
from benchtool.store.settings import aggregate
from benchtool.store.write import write_table

RUN_FORMAT = "benchtool-run-1"

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


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
        """
        if path.exists():
            raise WouldOverwrite(str(path))
        try:
            path.mkdir(parents=True)
        except FileExistsError:
            raise WouldOverwrite(str(path)) from None
        except OSError as error:
            raise InputError(
                f"the run folder {path} cannot be made ({error.strerror}); choose another place "
                f"with --out"
            ) from error
        run = cls(path)
        replace_text(path / "plan.toml", plan_text)
        replace_json(path / "metadata.json", {"format": RUN_FORMAT, **metadata})
        return run

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
        return read_text(self.path / "plan.toml")

    @property
    def metadata(self) -> dict[str, Any]:
        """The facts about the run."""
        return read_json(self.path / "metadata.json")

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
            RunStopped: it was deleted, moved or replaced.
            ResourceExhausted: it was made read-only.
        """
        if self._opened is None:
            return
        try:
            there = os.stat(self.path)
        except (FileNotFoundError, NotADirectoryError):
            raise RunStopped(
                f"the run folder {self.path} is not there any more: it was deleted or moved"
            ) from None
        if not os.path.samestat(there, self._opened):
            raise RunStopped(
                f"the run folder {self.path} is not the one that this run opened: another one was "
                f"put in its place"
            )
        effective = os.access in os.supports_effective_ids
        if not os.access(self.path, os.W_OK | os.X_OK, effective_ids=effective):
            raise ResourceExhausted(f"the run folder {self.path} was made read-only")

    def save_as(self, path: Path, facts: Mapping[str, Any], files: Sequence[AppendFile]) -> None:
        """Write the whole run into a new folder, from memory and open files, and own that one.

        Args:
            path: of the new folder.
            facts: to replace in the metadata.
            files: that grow while the run is measured.

        Raises:
            OSError: there is no room either; nothing is left there.
        """
        path.mkdir()
        try:
            for file in files:
                file.copy_to(path / file.path.name)
            replace_text(path / "plan.toml", self._plan_text)
            replace_json(path / "metadata.json", {**self._facts, **facts})
        except BaseException:
            shutil.rmtree(path, ignore_errors=True)
            raise
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

    def close(self) -> None:
        """Write settings.csv and the hashed Parquet from what is on disk.

        A sweep that has no point yet is left as it is; a pitch experiment has none ever.
        """
        self.check_in_place()
        if self.metadata.get("experiment") == "pitch":
            if (self.path / "samples.csv").is_file():
                self._seal_samples()
            return
        try:
            points = read_points(self.path)
        except FileFormatError:
            return
        write_table(self.path / "settings.csv", aggregate(points))
        self._seal_samples()

    def _seal_samples(self) -> None:
        parquet = self.path / "samples.parquet"
        parquet.unlink(missing_ok=True)
        seal(self.path / "samples.csv", parquet)
        stated = {
            "parquet_sha256": file_hash(parquet),
            "csv_sha256": file_hash(self.path / "samples.csv"),
        }
        self.update_metadata(samples=stated)

    def reopen(self) -> None:
        """Take away what `close` made, before the run goes on."""
        for name in ("samples.parquet", "settings.csv"):
            (self.path / name).unlink(missing_ok=True)
        if "samples" in self.metadata:
            self.update_metadata(samples={})


def check_run_name(name: str) -> None:
    """Refuse a name that no folder should have."""
    if not _NAME.fullmatch(name):
        raise InputError(
            f"{name!r} cannot name a run; use letters, digits, '.', '_' and '-' and begin with a "
            f"letter or digit"
        )


def free_run_path(folder: Path, date: str, name: str) -> Path:
    """Return FOLDER/DATE-NAME, with -2, -3 and so on behind it while that is taken."""
    check_run_name(name)
    return free_path(folder / f"{date}-{name}")


def free_path(path: Path) -> Path:
    """Return a path, with -2, -3 and so on behind it while that is taken."""
    free, count = path, 1
    while os.path.lexists(free):
        count += 1
        free = path.with_name(f"{path.name}-{count}")
    return free
