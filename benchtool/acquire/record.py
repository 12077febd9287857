"""Read a bench and put every sample on the disk before anything else is done with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from time import monotonic
from typing import Any

import numpy as np

from benchtool.acquire.visit_order import Visit, minutes
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

STEP_S = 0.1  # longest wait for samples in one read; limits and signals are seen at least as often


@dataclass(slots=True)
class LinkQuality:
    """Count what came and what the link lost, over all parts of a resumed run."""

    samples: int = 0
    lost: int = 0
    corrupt: int = 0
    repeated: int = 0


class Recorder:
    """Own the files of a run while it is measured.

    Args:
        start_s: time of the run at which this part of it begins; above 0 for a resumed one.
        before: what a resumed run has counted so far.
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
        self.bench = bench
        self.quality = replace(before) if before else LinkQuality()
        self._progress = progress
        self._names = [channel.name for channel in identity.channels]
        self._channels = identity.channels
        self._zero_s = bench.now_s() - start_s
        self._writer = RunWriter(run, identity.channels, identity.n_rotors)
        for file, fragment in self._writer.fragments.items():
            self.note("cut_line", f"the last line of {file} was cut and left out: {fragment}")
        self.append_point = self._writer.point

    @property
    def now_s(self) -> float:
        """Time since the run began."""
        return self.bench.now_s() - self._zero_s

    def read(self, phase: str, point: int = 0, timeout_s: float = STEP_S) -> Readings:
        """Read what arrived, write it, and return it with times since the run began.

        A signal waits for the end of this, so that no sample is lost between link and disk.
        """
        return self.store(self.bench.read(timeout_s), phase, point)

    def store(self, readings: Readings, phase: str, point: int = 0) -> Readings:
        """Write readings and return them with times since the run began.

        Raises:
            RunStopped, ResourceExhausted: they could not be written, or the run's folder is not
                there any more; once, later readings wait in memory for `rescue`.
        """
        time_s = readings.time_s - self._zero_s
        self.quality.samples += len(readings)
        self.quality.lost += readings.lost
        self.quality.corrupt += readings.corrupt
        self.quality.repeated += readings.repeated
        if len(readings):
            self._writer.samples(point, phase, time_s, readings.device_time_us, readings.values)
        else:
            self._writer.check()
        for message in readings.messages:
            self.note("device", message, point)
        for text in self._progress.annotations():
            self.note(ANNOTATION, text, point)
        return Readings(time_s, readings.device_time_us, readings.values)

    def collect(self, phase: str, seconds: float, point: int = 0) -> Recording:
        """Read for so long and return the samples."""
        parts: list[Readings] = []
        end_s = self.bench.now_s() + seconds
        while (left_s := end_s - self.bench.now_s()) > 1e-9:
            parts.append(self.read(phase, point, min(STEP_S, left_s)))
        return self.joined(parts)

    def joined(self, parts: list[Readings]) -> Recording:
        """Return readings as one recording, time_s first."""
        none = np.empty((0, len(self._channels)))
        values = np.concatenate([none, *(part.values for part in parts)])
        time_s = np.concatenate([none[:, 0], *(part.time_s for part in parts)])
        return Recording(
            (Channel("time_s", "s"), *self._channels), np.column_stack([time_s, values])
        )

    def see_standstill(self, at_least_s: float = 0.0) -> Standstill:
        """Read on until the rotors were seen to stand; put samples and what was seen on the disk.

        Raises:
            RunStopped, ResourceExhausted: they could not be written; after the look.
        """
        failed: list[BenchtoolError] = []

        def take(readings: Readings) -> None:
            try:
                self.store(readings, "end")
            except BenchtoolError as error:
                failed.append(error)

        state = self.bench.see_standstill(take, at_least_s)
        if state.text:
            self.note("standstill" if state.seen else "not_seen_to_stand", state.text)
        if failed:
            raise failed[0]
        return state

    def note(self, event: str, text: str, point: int = 0) -> None:
        """Put an event on the disk and publish it."""
        entry = Event(round(self.now_s, 6), event, text, point)
        self._writer.event(entry)
        self._progress.happened(entry)

    def link(self) -> dict[str, Any]:
        """Return how good the link was, for metadata.json.

        Counts of samples; a bench that measures more (messages, jitter) reports it in facts that
        begin with `link_`.
        """
        facts = self.bench.identity.facts
        measured = {name: text for name, text in facts.items() if name.startswith("link_")}
        return asdict(self.quality) | measured

    def sync(self) -> None:
        """Force the samples to the disk."""
        self._writer.sync()

    def finish(self, state: str, reason: str | None = None) -> None:
        """Put on the disk how the run ended."""
        self._writer.update_metadata(state=state, reason=reason, link=self.link())

    def rescue(self, error: BaseException) -> BaseException:
        """Return the error to raise after `error` ended the run and zero was commanded.

        Where the run's folder failed, the run is saved in another one first, and if that was what
        ended it, the error returned names it.
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

    def close(self) -> None:
        """Close the files."""
        self._writer.close()


class RunProgress:
    """Receive what a run does, and do nothing with it; displays override what they show.

    Calls come from the run's own thread and must return quickly.
    """

    def started(self, visits: int, done: int, expected_s: float) -> None:
        """Receive that a sweep of so many visits begins, some of them done already."""

    def visiting(self, visit: Visit) -> None:
        """Receive that a visit begins."""

    def measured(self, point: Point, remaining_s: float) -> None:
        """Receive a point that is on the disk, and the time that is left."""

    def happened(self, event: Event) -> None:
        """Receive an event that is on the disk."""

    def annotations(self) -> list[str]:
        """Return what the operator wrote since the last call, for the events of the run."""
        return []


NO_PROGRESS = frozenset({"device"})  # events that stand in events.jsonl but are not shown


class ProgressLines(RunProgress):
    """Say one line for every point and event; distances where `radius_m` is no None."""

    def __init__(self, radius_m: float | None, say: Callable[[str], None]) -> None:
        self._radius_m, self._say = radius_m, say
        self._visits = self._done = 0

    def started(self, visits: int, done: int, expected_s: float) -> None:
        self._visits, self._done = visits, done
        self._say(f"{visits - done} of {visits} visits to go, about {minutes(expected_s)}")

    def measured(self, point: Point, remaining_s: float) -> None:
        self._done += 1
        where = ""
        if self._radius_m is not None:
            where = f"  {point.kind:<9} z/R {point.plate_z_m / self._radius_m:5.2f}"
        self._say(
            f"{self._done}/{self._visits}{where}"
            f"  {max(point.pwm_us):4.0f} us  {point.thrust_N:8.3f} +- {point.thrust_se_N:.3f} N"
            f"  {'' if point.settled else 'not settled  '}{minutes(remaining_s)} left"
        )

    def happened(self, event: Event) -> None:
        if event.event not in NO_PROGRESS:
            self._say(f"{event.time_s:8.1f} s  {event.event}: {event.text}")


class SafeProgress(RunProgress):
    """Forward to another progress until it fails (a closed pipe, a terminal that went).

    A run continues when nobody looks; what it measures is on the disk. Time left is given in real
    seconds: a simulated bench's clock may run many times as fast.
    """

    def __init__(self, watcher: RunProgress | None) -> None:
        self._watcher = watcher or RunProgress()
        self._first: tuple[float, float] | None = None

    def _forward(self, method: Callable[..., None], *arguments: Any) -> None:
        try:
            method(*arguments)
        except OSError:
            self._watcher = RunProgress()

    def started(self, visits: int, done: int, expected_s: float) -> None:
        self._forward(self._watcher.started, visits, done, expected_s)

    def visiting(self, visit: Visit) -> None:
        self._forward(self._watcher.visiting, visit)

    def measured(self, point: Point, remaining_s: float) -> None:
        now_s = monotonic()
        self._first = self._first or (point.time_s, now_s)
        on_bench_s, real_s = point.time_s - self._first[0], now_s - self._first[1]
        if on_bench_s > real_s:  # never slower: whoever paused, goes on at the bench's pace
            remaining_s *= real_s / on_bench_s
        self._forward(self._watcher.measured, point, remaining_s)

    def happened(self, event: Event) -> None:
        self._forward(self._watcher.happened, event)

    def annotations(self) -> list[str]:
        return self._watcher.annotations()
