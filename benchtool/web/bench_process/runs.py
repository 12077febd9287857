"""Sweeps and recordings in the bench process, with remote pause."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import wait
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import replace
from pathlib import Path

from benchtool.acquire.experiment import Experiment
from benchtool.acquire.inputs import SweepInputs
from benchtool.acquire.live import LiveRecording, live_plan
from benchtool.acquire.operator import ARMING_QUESTION
from benchtool.acquire.record import RunProgress
from benchtool.acquire.resume import SweepStart, load_resume_state, prepare_resume
from benchtool.acquire.session import acquire, build_experiment
from benchtool.acquire.sweep import Sweep
from benchtool.acquire.visit_order import Visit
from benchtool.bench.guard import GuardedBench
from benchtool.bench.stop_requests import StoppableBench
from benchtool.core.errors import BenchError, BenchtoolError
from benchtool.core.rig import Rig
from benchtool.data.run.append import Event
from benchtool.data.run.points import Point
from benchtool.data.run.run import Run
from benchtool.tasks import Job, ReportProgress
from benchtool.web.bench_process.messages import StartLiveRecording, StartRun, SweepStatus
from benchtool.web.bench_process.publisher import EventPublisher

READ_TIMEOUT_S = 0.05


def close_run(_report: ReportProgress, path: Path) -> None:
    """Close a run; called in a separate process."""
    Run.open(path).close()


def prepare_run(_report: ReportProgress, path: Path) -> SweepStart:
    """Return the resume state of a run; called in a separate process."""
    return prepare_resume(load_resume_state(Run.open(path)))


class RunSupervisor(RunProgress):
    """Operator of sweeps and recordings on the page; publishes their progress.

    `pause`, `lose_page`, queues and event may be used from any thread.
    """

    def __init__(self, publisher: EventPublisher) -> None:
        self._publisher = publisher
        self._state = SweepStatus()
        self._radius_m: float | None = 1.0
        self._typed = ""
        self._paused = threading.Event()
        self.ended = threading.Event()  # of a live recording
        self.answers: queue.SimpleQueue[str] = queue.SimpleQueue()  # to the sweep's question
        self.texts: queue.SimpleQueue[str] = queue.SimpleQueue()  # annotations
        self._closing: threading.Thread | None = None
        self._needs_page, self._page_lost = True, False
        self.sweep_error: BenchtoolError | None = None  # of the last sweep

    @property
    def active(self) -> bool:
        return self._state.active and self._state.status != "closing"

    @property
    def noun(self) -> str:
        return self._state.noun

    def pause(self, on: bool) -> None:
        if on:
            self._paused.set()
            if self._state.status == "running":
                self._change(status="pausing")
        else:
            self._paused.clear()

    def lose_page(self, bench: StoppableBench, problem: str) -> None:
        """Pause a sweep or stop a pitch recording that needs its page.

        Manual throttle has the dead-man switch.
        """
        if not (self.active and self._needs_page) or self._state.status == "paused":
            return
        if self._page_lost:
            return
        self._page_lost = True
        if self._state.kind == "sweep":
            self._paused.set()
            bench.request_pause(problem)
        elif self._state.kind == "pitch":
            bench.request_stop(problem)

    def annotations(self) -> list[str]:
        return [self.texts.get_nowait() for _ in range(self.texts.qsize())]

    def start(
        self,
        bench: GuardedBench,
        rig: Rig,
        command: StartRun | StartLiveRecording,
        apply_throttle: Callable[[], object],
    ) -> None:
        """Sweep or record; the throttle is at zero when this returns or raises.

        A live recording calls `apply_throttle` until `ended` is set. A `BenchError` means that the
        bench is no longer usable, another error that the run could not start.
        """
        self.finish()
        self._paused.clear()
        self.ended.clear()
        experiment = self._build_experiment(bench, rig, command, apply_throttle)

        def begin(run: Run) -> None:
            self.annotations()  # discard those of the previous run
            self._page_lost = False
            self._needs_page = isinstance(command, StartLiveRecording) or command.needs_page
            if isinstance(command, StartRun):
                run.update_metadata(needs_page=command.needs_page)
            self._state = SweepStatus(status="running", kind=experiment.kind, run=str(run.path))
            self._publisher.publish(self._state)

        try:
            run = acquire(bench, experiment, self, experiment.display(self), begin)
            self._close(run, "ended", experiment.summary())
        except BenchtoolError as error:
            if experiment.run is None:
                raise
            self.sweep_error = error if experiment.kind == "sweep" else None
            self._close(experiment.run, "stopped", bench.add_standstill_text(str(error)))
            bench.require_standstill(ends_normally=True)
            if isinstance(error, BenchError):
                raise

    def _build_experiment(
        self,
        bench: GuardedBench,
        rig: Rig,
        command: StartRun | StartLiveRecording,
        apply_throttle: Callable[[], object],
    ) -> Experiment:
        if isinstance(command, StartLiveRecording):

            def is_running() -> bool:
                apply_throttle()
                return not self.ended.is_set()

            live_inputs = SweepInputs(plan=live_plan(command.name, rig), runs=command.runs)
            return LiveRecording(live_inputs, rig, self, is_running)
        self._typed = command.typed
        inputs = replace(
            command.inputs, address=bench.identity.address, out=None, yes=not command.typed
        )
        experiment = build_experiment(inputs, rig, self)
        if isinstance(experiment, Sweep) and experiment.resume_state:
            experiment.start = self._prepare_resume(bench, experiment.resume_state.run.path)
        return experiment

    def finish(self) -> None:
        if self._closing is not None:
            self._closing.join()

    def started(self, visits: int, done: int, expected_s: float) -> None:
        self._change(n_points=visits, n_measured=done, remaining_s=expected_s)

    def visiting(self, visit: Visit) -> None:
        self._change(status="running", point_text=visit.description(self._radius_m))

    def measured(self, point: Point, remaining_s: float) -> None:
        self._change(n_measured=self._state.n_measured + 1, remaining_s=remaining_s)

    def remaining(self, remaining_s: float) -> None:
        self._change(remaining_s=remaining_s)

    def is_paused(self) -> bool:
        return self._paused.is_set()

    def happened(self, event: Event) -> None:
        self._publisher.publish(event)
        if event.event == "paused":
            self._page_lost = False
            self._change(status="paused")
        elif event.event == "went_on":
            self._change(status="running")

    def _prepare_resume(self, bench: GuardedBench, run: Path) -> SweepStart:
        """Return the start of a resumed run, read by another process while this reads the bench."""
        job = Job(prepare_run, run, daemon=False)
        try:
            while not job.done():
                bench.read_and_buffer(READ_TIMEOUT_S)
            bench.pop_unread()
        finally:
            wait([job])
        start: SweepStart = job.result()
        return start

    def inform(self, text: str) -> None:
        """No-op: the page shows the status of the run."""

    warn = inform

    def display(self, radius_m: float | None) -> AbstractContextManager[RunProgress]:
        self._radius_m = radius_m
        return nullcontext(self)

    def answer(self, question: str, meanwhile: Callable[[], object] | None = None) -> str:
        """Return the typed confirmation, or publish a question and wait for the page's answer."""
        if question == ARMING_QUESTION:
            return self._typed
        with suppress(queue.Empty):
            while True:
                self.answers.get_nowait()
        self._change(status="asking", question=question)
        while True:
            if meanwhile is not None:
                meanwhile()
            with suppress(queue.Empty):
                text = self.answers.get_nowait()
                self._change(status="running", question="")
                return text

    def _close(self, run: Run, status: str, reason: str) -> None:
        """Write the run's files in a separate process while the bench is read.

        In a thread, this work (pandas, Parquet) blocked the bench loop longer than the device's
        watchdog timeout.
        """
        self._change(status="closing", run=str(run.path), question="", reason=reason)

        def close() -> None:
            result = reason
            if Job(close_run, run.path, daemon=False).exception() is not None:
                result = f"{reason}; the tables computed from its samples could not be written"
            self._change(status=status, point_text="", remaining_s=0.0, reason=result)

        self._closing = threading.Thread(target=close, name="closing")
        self._closing.start()

    def _change(self, **changes: object) -> None:
        self._state = replace(self._state, **changes)  # type: ignore[arg-type]
        self._publisher.publish(self._state)
