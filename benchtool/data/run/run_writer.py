"""Append to a run while it is measured, notice that it cannot be written, and save it elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from pathlib import Path
from tempfile import gettempdir
from typing import Any

from benchtool.core.array_type import Array
from benchtool.core.channel import Channel
from benchtool.core.errors import BenchtoolError, RunInterrupted
from benchtool.core.resource_errors import resource_error
from benchtool.data.atomic import sync_folder
from benchtool.data.run.append import AppendFile, Event
from benchtool.data.run.closing import read_marker
from benchtool.data.run.points import Point
from benchtool.data.run.run import Run, free_path
from benchtool.data.run.state import state_folder


class RunWriter:
    """Own the growing files of a run: samples.csv, points.csv and events.jsonl.

    The first write that fails, and the first call that finds another folder or file in place of
    the one that was opened, raises; `fault` holds that error from then on. What is appended later
    raises no more and waits for `rescue`.
    """

    def __init__(self, run: Run, channels: tuple[Channel, ...], n_rotors: int) -> None:
        self.run = run
        self.fault: BenchtoolError | None = None
        self._advice = ""
        self._files: list[AppendFile] = []
        try:
            run.watch()
            self._events = run.event_log()
            self._files.append(self._events)
            run.unseal()
            read_marker(run.path / "samples.csv")
            if run.metadata.get("state") != "running":
                run.update_metadata(state="running", reason=None)
            self._samples = run.sample_writer(channels)
            self._files.append(self._samples)
            self._points = run.point_writer(n_rotors)
            self._files.append(self._points)
            sync_folder(run.path)
        except BaseException as error:
            self.close()
            if isinstance(error, OSError):
                raise resource_error(
                    error, f"{run.path} cannot be written", "remove its cause, then go on"
                ) from error
            raise

    @property
    def fragments(self) -> dict[str, str]:
        """Cut lines that a killed process left at the end, by the name of their file."""
        parts = {"samples.csv": self._samples.fragment, "points.csv": self._points.fragment}
        return {name: fragment for name, fragment in parts.items() if fragment}

    def samples(
        self, point: int, phase: str, time_s: Array, device_time_us: Array, values: Array
    ) -> None:
        """Append samples; see `SampleWriter.append`."""
        self._attempt(lambda: self._samples.append(point, phase, time_s, device_time_us, values))

    def point(self, point: Point) -> None:
        """Append one point and force it to the disk, its samples before it."""

        def write() -> None:
            self._samples.sync()
            self._points.append(point)

        self._attempt(write)

    def event(self, event: Event) -> None:
        """Append one event and force it to the disk."""
        self._attempt(lambda: self._events.append(event))

    def update_metadata(self, **facts: Any) -> None:
        """Replace some facts of metadata.json in one step."""
        self._attempt(lambda: self.run.update_metadata(**facts))

    def sync(self) -> None:
        """Force the samples to the disk."""
        self._attempt(self._samples.sync)

    def check(self) -> None:
        """Raise when folder or files are not those that were opened, or may not be written.

        Raises:
            RunInterrupted: the folder or a file of it was deleted, moved or replaced.
            ResourceExhausted: the folder was made read-only.
        """
        self._attempt(lambda: None)

    def rescue(self) -> None:
        """After a fault save the whole run in a folder of its own and name it in `fault`.

        The run's path is that folder from then on. It stands beside the run, else in the folder
        for lasting state, else in the one for temporary files. Where none has room for all of the
        run, what could not be written to it is saved alone.
        """
        if self.fault is None:
            return
        lost = self.run.path
        places = (lost.parent, state_folder() / "rescued", Path(gettempdir()))
        where = "what was recorded could not be saved anywhere else"
        for whole, folder in product((True, False), places):
            try:
                if folder != lost.parent:
                    folder.mkdir(parents=True, exist_ok=True)
                path = free_path(folder / f"{lost.name}-rescued")
                self.run.save_as(path, {"rescued_from": str(lost)}, self._files, whole=whole)
            except (OSError, MemoryError):
                continue
            what = "what was recorded" if whole else f"what is not in {lost}, and only that,"
            where = f"{what} is saved in {path}"
            break
        self.fault = type(self.fault)(
            f"{self.fault}; zero was commanded to the motors; {where}{self._advice}"
        )

    def close(self) -> None:
        """Close the files; safe to call twice."""
        for file in self._files:
            try:
                file.close()
            except OSError:
                if self.fault is None:
                    raise

    def _attempt(self, write: Callable[[], None]) -> None:
        try:
            write()
            if self.fault is None:
                self._look()
        except OSError as error:
            if self.fault is None:
                self._advice = "; remove its cause, then go on"
                self.fault = resource_error(error, f"{self.run.path} cannot be written")
                raise self.fault from error
        except BenchtoolError as error:
            if self.fault is None:
                self.fault = error
                raise

    def _look(self) -> None:
        self.run.check_in_place()
        for file in self._files:
            if not file.is_in_place():
                raise RunInterrupted(
                    f"{file.path} is no longer the file that this run writes: it was deleted, "
                    f"moved or replaced"
                )
