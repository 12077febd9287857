"""Writer of a run during measurement; saves the run elsewhere when it cannot be written."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from pathlib import Path
from tempfile import gettempdir
from typing import Any

from benchtool.core.channel import Channel
from benchtool.core.errors import BenchtoolError, RunInterrupted
from benchtool.core.units import Array
from benchtool.core.user_file import resource_error
from benchtool.data.atomic import sync_folder
from benchtool.data.run.append import AppendFile, Event, install_marked_samples
from benchtool.data.run.points import Point
from benchtool.data.run.run import Run, free_path
from benchtool.data.run.state import state_folder


class RunWriter:
    """Writer of samples.csv, points.csv, events.jsonl and metadata.json.

    The first failed write, or the first call that finds the folder or a file replaced, raises
    that error and stores it in `fault`. Later calls raise no errors; `rescue` saves their data.
    """

    def __init__(self, run: Run, channels: tuple[Channel, ...], n_rotors: int) -> None:
        self.run = run
        self.fault: BenchtoolError | None = None
        self._remedy = ""
        self._files: list[AppendFile] = []
        try:
            run.watch()
            self._events = run.event_log()
            self._files.append(self._events)
            run.unseal()
            install_marked_samples(run.path / "samples.csv")
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
                    error, f"{run.path} cannot be written", "remove the cause, then resume"
                ) from error
            raise

    @property
    def fragments(self) -> dict[str, str]:
        """Incomplete last lines of a killed process, by file name."""
        fragments = {"samples.csv": self._samples.fragment, "points.csv": self._points.fragment}
        return {name: fragment for name, fragment in fragments.items() if fragment}

    def samples(
        self, point: int, phase: str, time_s: Array, device_time_us: Array, values: Array
    ) -> None:
        """Append samples; see `SampleWriter.append`."""
        self._attempt(lambda: self._samples.append(point, phase, time_s, device_time_us, values))

    def point(self, point: Point) -> None:
        """Append one point and flush it to the disk, after its samples."""

        def write() -> None:
            self._samples.sync()
            self._points.append(point)

        self._attempt(write)

    def event(self, event: Event) -> None:
        """Append one event and flush it to the disk."""
        self._attempt(lambda: self._events.append(event))

    def update_metadata(self, **facts: Any) -> None:
        """Replace keys of metadata.json; the file is written atomically."""
        self._attempt(lambda: self.run.update_metadata(**facts))

    def sync(self) -> None:
        """Flush the samples to the disk."""
        self._attempt(self._samples.sync)

    def check(self) -> None:
        """Raise if the folder or a file was replaced or is read-only; see `Run.check_in_place`."""
        self._attempt(lambda: None)

    def rescue(self) -> None:
        """After a fault, save the run to a new folder and add its path to `fault`.

        Folders in order: parent of the run, state folder, temporary folder. If no folder has
        space for the whole run, only the unwritten data are saved; else it is the run's new path.
        """
        if self.fault is None:
            return
        old_path = self.run.path
        folders = (old_path.parent, state_folder() / "rescued", Path(gettempdir()))
        outcome = "the recorded data could not be saved to another folder"
        for whole, folder in product((True, False), folders):
            try:
                if folder != old_path.parent:
                    folder.mkdir(parents=True, exist_ok=True)
                path = free_path(folder / f"{old_path.name}-rescued")
                self.run.save_as(path, {"rescued_from": str(old_path)}, self._files, whole=whole)
            except (OSError, MemoryError):
                continue
            data = "the recorded data are" if whole else f"only data missing in {old_path} are"
            outcome = f"{data} saved in {path}"
            break
        self.fault = type(self.fault)(
            f"{self.fault}; zero was commanded to the motors; {outcome}{self._remedy}"
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
                self.run.check_in_place()
                for path in (file.path for file in self._files if not file.is_in_place()):
                    raise RunInterrupted(f"{path} was deleted, moved or replaced during the run")
        except OSError as error:
            if self.fault is None:
                self._remedy = "; remove the cause, then resume"
                self.fault = resource_error(error, f"{self.run.path} cannot be written")
                raise self.fault from error
        except BenchtoolError as error:
            if self.fault is None:
                self.fault = error
                raise
