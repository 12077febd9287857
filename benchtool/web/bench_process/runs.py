"""Sweeps and recordings in the bench process, with remote pause."""

from __future__ import annotations

import queue
import signal
import threading
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from multiprocessing import get_context
from pathlib import Path
from typing import Literal

from benchtool.acquire.arming import CONFIRMATION, require_unattended
from benchtool.acquire.calibration import find_calibration
from benchtool.acquire.check_plan import check_plan
from benchtool.acquire.live_record import live_plan, record_live
from benchtool.acquire.pitch_experiment import expected_extremes
from benchtool.acquire.pitch_record import record_pitch, summary_line
from benchtool.acquire.record import RunProgress
from benchtool.acquire.resume import load_resume_state, prepare_resume, require_same_device
from benchtool.acquire.run_creation import new_live_run, new_pitch_run, new_run
from benchtool.acquire.stage_selection import select_stage
from benchtool.acquire.sweep import SweepStart, run_sweep
from benchtool.acquire.visit_order import Visit
from benchtool.bench.bench import DeviceInfo
from benchtool.bench.guard import GuardedBench
from benchtool.bench.wrappers import StoppableBench
from benchtool.core.errors import BenchError, BenchtoolError, InputError, RunInterrupted
from benchtool.core.rig import Rig
from benchtool.data.run.append import Event
from benchtool.data.run.points import Point
from benchtool.data.run.run import Run
from benchtool.web.bench_process.messages import (
    RunEvent,
    StartLiveRecording,
    StartRecording,
    StartSweep,
    SweepStatus,
)
from benchtool.web.bench_process.publisher import EventPublisher

READ_TIMEOUT_S = 0.05


def close_run(path: Path) -> None:
    """Close a run; called in a separate process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Run.open(path).close()


def prepare_run(path: Path) -> SweepStart | str:
    """Return the resume state of a run or an error message; called in a separate process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        return prepare_resume(load_resume_state(Run.open(path)))
    except BenchtoolError as error:
        return str(error)


def require_armed(typed: str, identity: DeviceInfo, rig: Rig) -> None:
    """Check the typed arming confirmation; a simulated or checked bench needs none."""
    if not typed:
        require_unattended(identity, rig, datetime.now().astimezone().date())
    elif typed.strip() != CONFIRMATION:
        raise RunInterrupted(f"not armed: {CONFIRMATION} was not typed; no motor was started")


class RunSupervisor(RunProgress):
    """Supervisor of sweeps and recordings; publishes their progress."""

    def __init__(self, publisher: EventPublisher) -> None:
        self._publisher = publisher
        self._state = SweepStatus()
        self._radius_m: float | None = 1.0
        self._paused, self._ended = threading.Event(), threading.Event()
        self._answers: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._annotations: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._closing: threading.Thread | None = None
        self._needs_page, self._page_lost = True, False

    @property
    def active(self) -> bool:
        return self._state.active and self._state.status != "closing"

    @property
    def noun(self) -> str:
        return self._state.noun

    def pause(self, on: bool) -> None:
        """Pause or continue the sweep; callable from any thread."""
        if on:
            self._paused.set()
            if self._state.status == "running":
                self._change(status="pausing")
        else:
            self._paused.clear()

    def lose_page(self, bench: StoppableBench, problem: str) -> None:
        """Pause a sweep or stop a pitch recording that needs its page; callable from any thread.

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

    def answer(self, text: str) -> None:
        """Answer the sweep's question; callable from any thread."""
        self._answers.put(text)

    def annotate(self, text: str) -> None:
        """Add a text to the events of the run; callable from any thread."""
        self._annotations.put(text)

    def annotations(self) -> list[str]:
        return [self._annotations.get_nowait() for _ in range(self._annotations.qsize())]

    def sweep(self, bench: GuardedBench, rig: Rig, command: StartSweep) -> None:
        """Run a sweep; the throttle is at zero when this returns or raises.

        Raises:
            BenchtoolError: the sweep could not start.
            BenchError: the bench is no longer usable.
        """
        self.finish()
        self._paused.clear()
        identity = bench.identity
        inputs = command.inputs
        resume_state = load_resume_state(Run.open(inputs.resume)) if inputs.resume else None
        if resume_state is not None:
            plan, rig = resume_state.plan, resume_state.rig
        else:
            plan = inputs.plan.resolved(rig)
        self._radius_m = rig.propulsion.radius_m if plan.plate.used else None
        check_plan(plan, rig, identity.limits)
        if resume_state is not None:
            calibration = resume_state.calibration
        else:
            calibration = find_calibration(inputs.calibration, identity)
        stage_name = inputs.stage or (resume_state.stage if resume_state else None)
        stage = select_stage(
            stage_name, bench, rig, lambda text: self._ask(bench, text), plate=plan.plate.used
        )
        require_armed(command.typed, identity, rig)
        start = None
        if resume_state is not None:
            require_same_device(resume_state, identity)
            start = self._prepare_resume(bench, resume_state.run.path)
        with bench.interruptible():
            stage.open()
        run: Run | None = None
        try:
            run = resume_state.run if resume_state else new_run(
                (inputs.runs, None), plan, rig, identity,
                operator=inputs.operator, air=inputs.air, calibration=calibration,
            )  # fmt: skip
            run.update_metadata(needs_page=command.needs_page)
            self._begin(SweepStatus(status="running", run=str(run.path)), command.needs_page)
            summary = run_sweep(
                bench, stage, plan, rig, run, self,
                calibration=calibration, start=start, is_paused=self._paused.is_set,
            )  # fmt: skip
            self._close(run, "ended", summary.text())
        except BenchtoolError as error:
            if run is not None:
                self._close(run, "stopped", bench.add_standstill_text(str(error)))
                bench.require_standstill(ends_normally=True)
            if run is None or isinstance(error, BenchError):
                raise
        finally:
            stage.close()

    def record(self, bench: GuardedBench, rig: Rig, command: StartRecording) -> None:
        """Record a pitch experiment; raises as `sweep` and ends at zero throttle."""
        self.finish()
        identity, experiment = bench.identity, command.experiment
        expected_extremes(identity, experiment, rig)
        require_armed(command.typed, identity, rig)
        run = new_pitch_run((command.runs, command.name, None), experiment, rig, identity)
        run.update_metadata(needs_page=command.needs_page)

        def measure() -> str:
            summary = record_pitch(
                bench, rig, experiment, run, self, lambda left_s: self._change(remaining_s=left_s)
            )
            return summary_line(summary)

        self._record(bench, run, "pitch", measure, command.needs_page)

    def record_live(
        self,
        bench: GuardedBench,
        rig: Rig,
        command: StartLiveRecording,
        apply_throttle: Callable[[], object],
    ) -> None:
        """Record under manual throttle until `end_live`; raises as `sweep`."""
        self.finish()
        self._ended.clear()
        calibration = find_calibration(None, bench.identity)
        plan = live_plan(command.name, rig)
        run = new_live_run(command.runs, plan, rig, bench.identity, calibration=calibration)

        def is_running() -> bool:
            apply_throttle()
            return not self._ended.is_set()

        self._record(
            bench, run, "live",
            lambda: record_live(bench, rig, plan, run, self, is_running, calibration).text(),
        )  # fmt: skip

    def end_live(self) -> None:
        """End a live recording; callable from any thread."""
        self._ended.set()

    def _record(
        self,
        bench: GuardedBench,
        run: Run,
        kind: Literal["pitch", "live"],
        measure: Callable[[], str],
        needs_page: bool = True,
    ) -> None:
        self._begin(SweepStatus(status="running", kind=kind, run=str(run.path)), needs_page)
        try:
            self._close(run, "ended", measure())
        except BenchtoolError as error:
            self._close(run, "stopped", bench.add_standstill_text(str(error)))
            bench.require_standstill(ends_normally=True)
            if isinstance(error, BenchError):
                raise

    def finish(self) -> None:
        if self._closing is not None:
            self._closing.join()

    def started(self, visits: int, done: int, expected_s: float) -> None:
        self._change(n_points=visits, n_measured=done, remaining_s=expected_s)

    def visiting(self, visit: Visit) -> None:
        self._change(status="running", point_text=visit.description(self._radius_m))

    def measured(self, point: Point, remaining_s: float) -> None:
        self._change(n_measured=self._state.n_measured + 1, remaining_s=remaining_s)

    def happened(self, event: Event) -> None:
        self._publisher.publish(RunEvent(event))
        if event.event == "paused":
            self._page_lost = False
            self._change(status="paused")
        elif event.event == "went_on":
            self._change(status="running")

    def _prepare_resume(self, bench: GuardedBench, run: Path) -> SweepStart:
        """Return the start of a resumed run, read by another process while this reads the bench."""
        with ProcessPoolExecutor(1, get_context("spawn")) as pool:
            future = pool.submit(prepare_run, run)
            while not future.done():
                bench.read_and_buffer(READ_TIMEOUT_S)
            bench.pop_unread()
            start = future.result()
        if isinstance(start, str):
            raise InputError(start)
        return start

    def _ask(self, bench: GuardedBench, question: str) -> str:
        """Publish a question and read the bench until the answer arrives."""
        with suppress(queue.Empty):
            while True:
                self._answers.get_nowait()
        self._change(status="asking", question=question)
        while True:
            bench.read_and_buffer(READ_TIMEOUT_S)
            with suppress(queue.Empty):
                text = self._answers.get_nowait()
                self._change(status="running", question="")
                return text

    def _close(self, run: Run, status: str, reason: str) -> None:
        """Write the run's files in a separate process while the bench is read.

        In a thread, this work (pandas, Parquet) blocked the bench loop longer than the device's
        watchdog timeout.
        """
        self._change(status="closing", run=str(run.path), question="", reason=reason)

        def close() -> None:
            closing = get_context("spawn").Process(target=close_run, args=(run.path,))
            closing.start()
            closing.join()
            result = reason
            if closing.exitcode:
                result = f"{reason}; the tables computed from its samples could not be written"
            self._change(status=status, point_text="", remaining_s=0.0, reason=result)

        self._closing = threading.Thread(target=close, name="closing")
        self._closing.start()

    def _begin(self, state: SweepStatus, needs_page: bool) -> None:
        self.annotations()  # discard those of the previous run
        self._needs_page, self._page_lost = needs_page, False
        self._state = state
        self._publisher.publish(state)

    def _change(self, **changes: object) -> None:
        self._state = replace(self._state, **changes)  # type: ignore[arg-type]
        self._publisher.publish(self._state)
