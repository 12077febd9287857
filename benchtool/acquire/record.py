"""Recorder: every sample is written to disk before it is used."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from time import monotonic
from typing import Any

import numpy as np

from benchtool.acquire.visit_order import Visit, format_duration
from benchtool.bench.bench import Readings
from benchtool.bench.guard import GuardedBench
from benchtool.bench.standstill import Standstill
from benchtool.core.channel import Channel
from benchtool.core.errors import BenchtoolError
from benchtool.core.recording import Recording
from benchtool.data.run.append import ANNOTATION, Event
from benchtool.data.run.points import Point
from benchtool.data.run.run import Run
from benchtool.data.run.run_writer import RunWriter

STEP_S = 0.1  # maximum wait in one read; limits and signals are checked at least as often


@dataclass(slots=True)
class LinkQuality:
    """Counts of received and lost samples, over all parts of a resumed run."""

    samples: int = 0
    lost: int = 0
    corrupt: int = 0
    repeated: int = 0


class Samples:
    """Growing table of the samples of a visit, with times since the start of the run."""

    def __init__(self, channels: tuple[Channel, ...], zero_s: float) -> None:
        self._channels = (Channel("time_s", "s"), *channels)
        self._zero_s = zero_s
        self._rows = np.empty((256, len(self._channels)))
        self._n_rows = 0

    def __len__(self) -> int:
        return self._n_rows

    def append(self, readings: Readings) -> None:
        """Append readings; the only copy of a sample between driver and point."""
        start, self._n_rows = self._n_rows, self._n_rows + len(readings)
        while self._n_rows > len(self._rows):
            self._rows = np.concatenate([self._rows, np.empty_like(self._rows)])
        self._rows[start : self._n_rows, 0] = readings.time_s - self._zero_s
        self._rows[start : self._n_rows, 1:] = readings.values

    def recording(self, start: int = 0) -> Recording:
        """Return the samples from a row on, without copying."""
        return Recording(self._channels, self._rows[start : self._n_rows])


class Recorder:
    """Recorder of a bench into a run folder.

    Args:
        start_s: run time of the start of this part; above 0 for a resumed run.
        before: counts of the earlier parts.
    """

    def __init__(
        self,
        bench: GuardedBench,
        run: Run,
        progress: RunProgress,
        start_s: float = 0.0,
        before: LinkQuality | None = None,
    ) -> None:
        identity = bench.identity
        self.bench, self.run = bench, run
        self.quality = replace(before) if before else LinkQuality()
        self._progress = progress
        self._zero_s = bench.now_s() - start_s
        self._writer = RunWriter(run, identity.channels, identity.n_rotors)
        for file, fragment in self._writer.fragments.items():
            self.record_event(
                "cut_line", f"the incomplete last line of {file} was removed: {fragment}"
            )
        self.append_point = self._writer.point
        self.sync, self.close = self._writer.sync, self._writer.close

    @property
    def now_s(self) -> float:
        """Time since the start of the run."""
        return self.bench.now_s() - self._zero_s

    def read(self, phase: str, point: int = 0, timeout_s: float = STEP_S) -> Readings:
        """Read and write samples.

        Signals are deferred until it returns, so that no sample is lost.
        """
        return self.store(self.bench.read(timeout_s), phase, point)

    def store(self, readings: Readings, phase: str, point: int = 0) -> Readings:
        """Write readings and return them.

        Raises:
            RunInterrupted, ResourceExhausted: writing failed, or the run folder is gone; raised
                once, later readings are kept in memory for `rescue`.
        """
        self.quality.samples += len(readings)
        self.quality.lost += readings.lost
        self.quality.corrupt += readings.corrupt
        self.quality.repeated += readings.repeated
        if len(readings):
            time_s = readings.time_s - self._zero_s
            self._writer.samples(point, phase, time_s, readings.device_time_us, readings.values)
        else:
            self._writer.check()
        for message in readings.messages:
            self.record_event("device", message, point)
        for text in self._progress.annotations():
            self.record_event(ANNOTATION, text, point)
        return readings

    def new_samples(self) -> Samples:
        """Return an empty table for the samples of a visit."""
        return Samples(self.bench.identity.channels, self._zero_s)

    def collect(self, phase: str, seconds: float, point: int = 0) -> Recording:
        """Read for a duration and return the samples."""
        samples = self.new_samples()
        end_s = self.bench.now_s() + seconds
        while (remaining_s := end_s - self.bench.now_s()) > 1e-9:
            samples.append(self.read(phase, point, min(STEP_S, remaining_s)))
        return samples.recording()

    def see_standstill(self, at_least_s: float = 0.0) -> Standstill:
        """Read until standstill is confirmed; write samples and result to disk.

        Raises:
            RunInterrupted, ResourceExhausted: writing failed; raised after the check.
        """
        failed: list[BenchtoolError] = []

        def store(readings: Readings) -> None:
            try:
                self.store(readings, "end")
            except BenchtoolError as error:
                failed.append(error)

        state = self.bench.stop_and_check_standstill(store, at_least_s)
        if state.text:
            self.record_event(
                "standstill" if state.is_confirmed else "not_seen_to_stand", state.text
            )
        if failed:
            raise failed[0]
        return state

    def record_event(self, event: str, text: str, point: int = 0) -> None:
        """Write an event to disk and publish it."""
        entry = Event(round(self.now_s, 6), event, text, point)
        self._writer.event(entry)
        self._progress.happened(entry)

    def finish(self, state: str, reason: str | None = None) -> None:
        """Write the final state and the link quality of the run to disk."""
        facts = self.bench.identity.facts
        link = {name: text for name, text in facts.items() if name.startswith("link_")}
        self._writer.update_metadata(state=state, reason=reason, link=asdict(self.quality) | link)

    def rescue(self, error: BaseException) -> BaseException:
        """Return the error to raise after `error` ended the run and zero was commanded.

        If the run folder failed, the run is saved in another folder first; if this failure ended
        the run, the returned error names that folder.
        """
        fault = self._writer.fault
        if fault is None:
            return error
        self._writer.rescue()
        rescued = self._writer.fault
        assert rescued is not None
        if error is fault:
            return rescued
        self._progress.happened(Event(round(self.now_s, 6), "rescued", str(rescued)))
        return error


class RunProgress:
    """Progress callbacks of a run (no-op); displays override them.

    Calls come from the thread of the run and must return quickly.
    """

    def started(self, visits: int, done: int, expected_s: float) -> None:
        """Handle the start of a sweep, with total and completed visits."""

    def visiting(self, visit: Visit) -> None:
        """Handle the start of a visit."""

    def measured(self, point: Point, remaining_s: float) -> None:
        """Handle a stored point and the remaining time."""

    def remaining(self, remaining_s: float) -> None:
        """Handle the remaining time of a pitch recording, about every second."""

    def happened(self, event: Event) -> None:
        """Handle a stored event."""

    def annotations(self) -> list[str]:
        """Return the operator's annotations since the last call."""
        return []

    def is_paused(self) -> bool:
        """Return True while a sweep waits before its next point, at zero throttle."""
        return False


BAR_WIDTH = 30  # characters
NO_PROGRESS = frozenset({"device"})  # events in events.jsonl that are not shown


class ProgressLines(RunProgress):
    """Print one line for every point and event; with distances if `radius_m` is given."""

    def __init__(self, radius_m: float | None, write: Callable[[str], None]) -> None:
        self._radius_m, self._write = radius_m, write
        self._visits = self._done = 0

    def started(self, visits: int, done: int, expected_s: float) -> None:
        self._visits, self._done = visits, done
        self._write(
            f"{visits - done} of {visits} visits remaining, about {format_duration(expected_s)}"
        )

    def measured(self, point: Point, remaining_s: float) -> None:
        self._done += 1
        where = ""
        if self._radius_m is not None:
            where = f"  {point.kind:<9} z/R {point.plate_z_m / self._radius_m:5.2f}"
        self._write(
            f"{self._done}/{self._visits}{where}"
            f"  {max(point.pwm_us):4.0f} us  {point.thrust_N:8.3f} +- {point.thrust_se_N:.3f} N"
            f"  {'' if point.settled else 'not settled  '}{format_duration(remaining_s)} left"
        )

    def happened(self, event: Event) -> None:
        if event.event not in NO_PROGRESS:
            self._write(f"{event.time_s:8.1f} s  {event.event}: {event.text}")


class ProgressBar(RunProgress):
    """One line on standard error with a bar, the measured visits and the remaining time."""

    def __init__(self) -> None:
        self._visits = self._done = 0

    def started(self, visits: int, done: int, expected_s: float) -> None:
        self._visits, self._done = visits, done
        self._show(expected_s)

    def measured(self, point: Point, remaining_s: float) -> None:
        self._done += 1
        self._show(remaining_s)

    def _show(self, remaining_s: float) -> None:
        bar = "#" * (BAR_WIDTH * self._done // max(self._visits, 1))
        left = format_duration(remaining_s)
        sys.stderr.write(
            f"\r[{bar:<{BAR_WIDTH}}] {self._done}/{self._visits} visits, {left} left  "
        )
        sys.stderr.flush()


class SafeProgress(RunProgress):
    """Wrapper that forwards progress until a call fails (closed pipe or terminal).

    The run continues without display. The remaining time is in real seconds, since the clock of a
    simulated bench may run much faster.
    """

    def __init__(self, progress: RunProgress | None) -> None:
        self._progress = progress or RunProgress()
        self._first: tuple[float, float] | None = None

    def _forward(self, method: Callable[..., None], *arguments: Any) -> None:
        try:
            method(*arguments)
        except OSError:
            self._progress = RunProgress()

    def started(self, visits: int, done: int, expected_s: float) -> None:
        self._forward(self._progress.started, visits, done, expected_s)

    def visiting(self, visit: Visit) -> None:
        self._forward(self._progress.visiting, visit)

    def measured(self, point: Point, remaining_s: float) -> None:
        now_s = monotonic()
        self._first = self._first or (point.time_s, now_s)
        on_bench_s, real_s = point.time_s - self._first[0], now_s - self._first[1]
        if on_bench_s > real_s:  # never slower, since a pause is followed by the bench's pace
            remaining_s *= real_s / on_bench_s
        self._forward(self._progress.measured, point, remaining_s)

    def remaining(self, remaining_s: float) -> None:
        self._forward(self._progress.remaining, remaining_s)

    def happened(self, event: Event) -> None:
        self._forward(self._progress.happened, event)

    def annotations(self) -> list[str]:
        return self._progress.annotations()

    def is_paused(self) -> bool:
        return self._progress.is_paused()
