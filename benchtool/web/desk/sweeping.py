"""Run a sweep for the page: the command line's own functions, watched and paused from afar."""

from __future__ import annotations

import queue
import signal
import threading
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from multiprocessing import get_context
from pathlib import Path

from benchtool.acquire.arming import CONFIRMATION, require_unattended
from benchtool.acquire.calibration_file import calibration_for
from benchtool.acquire.check_plan import check_plan
from benchtool.acquire.new_run import new_run
from benchtool.acquire.order import Visit
from benchtool.acquire.resume import prepare, require_same_device, unfinished
from benchtool.acquire.stage_choice import stage_for
from benchtool.acquire.sweep import Start, run_sweep
from benchtool.bench.bench import Identity
from benchtool.bench.guard import GuardedBench
from benchtool.core.counted import counted
from benchtool.core.rig import Rig
from benchtool.errors import BenchError, BenchtoolError, InputError, RunStopped
from benchtool.store import Event, Point, Run
from benchtool.web.desk.asks import Sweep
from benchtool.web.desk.news import Happened, Swept
from benchtool.web.desk.outbox import Outbox

LOOK_S = 0.05


def close_run(path: Path) -> None:
    """Close a run; a process of its own does this."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Run.open(path).close()


def prepare_run(path: Path) -> Start | str:
    """Return where a run goes on, or why it does not; a process of its own does this."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        return prepare(unfinished(Run.open(path)))
    except BenchtoolError as error:
        return str(error)


def require_armed(typed: str, identity: Identity, rig: Rig) -> None:
    """Refuse to spin without what the operator types, but on a simulated or checked bench.

    Raises:
        RunStopped: it was not typed.
    """
    if not typed:
        require_unattended(identity, rig, datetime.now().astimezone().date())
    elif typed.strip() != CONFIRMATION:
        raise RunStopped(f"not armed: {CONFIRMATION} was not typed; nothing was spun")


class Sweeping:
    """Hold what page and sweep say to each other; it is the sweep's Progress.

    Args:
        outbox: to the page.
    """

    def __init__(self, outbox: Outbox) -> None:
        self._outbox = outbox
        self._state = Swept()
        self._radius_m = 1.0
        self._paused = threading.Event()
        self._answers: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._closing: threading.Thread | None = None

    @property
    def active(self) -> bool:
        """Whether a sweep or a recording has the bench."""
        return self._state.active and self._state.status != "closing"

    @property
    def what(self) -> str:
        """What has it, in a word."""
        return "recording" if self._state.pitch else "sweep"

    def pause(self, on: bool) -> None:
        """Let the sweep wait or go on, from any thread."""
        if on:
            self._paused.set()
            if self._state.status == "running":
                self.tell(status="pausing")
        else:
            self._paused.clear()

    def answer(self, text: str) -> None:
        """Answer the sweep's question, from any thread."""
        self._answers.put(text)

    def run(self, bench: GuardedBench, rig: Rig, ask: Sweep) -> None:
        """Sweep; motors are at zero when this returns or raises.

        Raises:
            BenchtoolError: why it could not begin.
            BenchError: the bench is not to be used any more.
        """
        self.finish()
        self._paused.clear()
        identity = bench.identity
        rest = unfinished(Run.open(ask.resume)) if ask.resume else None
        if rest is not None:
            plan, rig = rest.plan, rest.rig
        elif ask.plan is not None:
            plan = ask.plan.resolved(rig)
        else:
            raise InputError("neither a plan nor a run to go on with was given")
        self._radius_m = rig.propulsion.radius_m
        check_plan(plan, rig, identity.limits)
        scale = rest.calibration if rest else calibration_for(ask.calibration, identity)
        chosen = ask.stage or (rest.stage if rest else None)
        stage = stage_for(chosen, bench, rig, lambda text: self._ask(bench, text))
        require_armed(ask.typed, identity, rig)
        start = None
        if rest is not None:
            require_same_device(rest, identity)
            start = self._prepared(bench, rest.run.path)
        with bench.interruptible():
            stage.open()
        run: Run | None = None
        try:
            run = rest.run if rest else new_run(
                (ask.runs, None), plan, rig, identity,
                operator=ask.operator, air=ask.air, calibration=scale,
            )  # fmt: skip
            self.begin(Swept(status="running", run=str(run.path)))
            summary = run_sweep(
                bench, stage, plan, rig, run, self,
                calibration=scale, start=start, waits=self._waits,
            )  # fmt: skip
            reason = (
                f"{counted(summary.measured, 'point')}, {summary.unsettled} not settled, "
                f"{counted(summary.tares, 'tare')}, {counted(summary.samples, 'sample')}, "
                f"{summary.lost} lost"
            )
            self.close(run, "ended", reason)
        except BenchtoolError as error:
            if run is not None:
                self.close(run, "stopped", bench.with_standstill(str(error)))
                bench.require_standstill(ends_normally=True)
            if run is None or isinstance(error, BenchError):
                raise
        finally:
            stage.close()

    def finish(self) -> None:
        """Wait until the files of the last run are closed."""
        if self._closing is not None:
            self._closing.join()

    def started(self, visits: int, done: int, expected_s: float) -> None:
        self.tell(visits=visits, done=done, left_s=expected_s)

    def visiting(self, visit: Visit) -> None:
        place = visit.setting.place
        where = "parked" if place.parked else f"z/R {place.z_m / self._radius_m:.2f}"
        self.tell(status="running", now=f"{visit.kind} {where}, {visit.setting.level_us:.0f} us")

    def measured(self, point: Point, remaining_s: float) -> None:
        self.tell(done=self._state.done + 1, left_s=remaining_s)

    def happened(self, event: Event) -> None:
        self._outbox.tell(Happened(event))
        if event.event == "paused":
            self.tell(status="paused")
        elif event.event == "went_on":
            self.tell(status="running")

    def _prepared(self, bench: GuardedBench, run: Path) -> Start:
        """Read where a run goes on, in a process of its own while the bench is read on."""
        with ProcessPoolExecutor(1, get_context("spawn")) as pool:
            reading = pool.submit(prepare_run, run)
            while not reading.done():
                bench.listen(LOOK_S)
            bench.take_kept()
            start = reading.result()
        if isinstance(start, str):
            raise InputError(start)
        return start

    def _waits(self) -> bool:
        return self._paused.is_set()

    def _ask(self, bench: GuardedBench, question: str) -> str:
        """Put a question to the page and listen to the bench until it is answered."""
        with suppress(queue.Empty):
            while True:
                self._answers.get_nowait()
        self.tell(status="asking", question=question)
        while True:
            bench.listen(LOOK_S)
            with suppress(queue.Empty):
                text = self._answers.get_nowait()
                self.tell(status="running", question="")
                return text

    def close(self, run: Run, status: str, reason: str) -> None:
        """Finish the files beside the bench, which goes on being read.

        In a process of its own: a thread's share of this work (pandas, Parquet) kept the loop that
        reads from doing so for longer than the device's watchdog waits.
        """
        self.tell(status="closing", run=str(run.path), question="", reason=reason)

        def close() -> None:
            closing = get_context("spawn").Process(target=close_run, args=(run.path,))
            closing.start()
            closing.join()
            said = reason
            if closing.exitcode:
                said = f"{reason}; the tables made from its samples could not be written"
            self.tell(status=status, now="", left_s=0.0, reason=said)

        self._closing = threading.Thread(target=close, name="closing")
        self._closing.start()

    def begin(self, state: Swept) -> None:
        """Tell of another run."""
        self._state = state
        self.tell()

    def tell(self, **changes: object) -> None:
        """Tell what is other than it was."""
        self._state = replace(self._state, **changes)  # type: ignore[arg-type]
        self._outbox.tell(self._state)
