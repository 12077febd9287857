"""Experiment of one run: its recording, which ends at standstill, and its run folder."""

from __future__ import annotations

import platform
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import asdict
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from typing import Any, ClassVar, Literal

from benchtool import __version__
from benchtool.acquire.inputs import RecordInputs, SweepInputs, user_name
from benchtool.acquire.motors import Motors
from benchtool.acquire.operator import Operator
from benchtool.acquire.record import Recorder, RunProgress, SafeProgress
from benchtool.bench.bench import DeviceInfo
from benchtool.bench.guard import GuardedBench
from benchtool.core.air import Air
from benchtool.core.errors import StandstillNotConfirmed
from benchtool.core.rig import Rig
from benchtool.data.run.run import Run, free_run_path

RAMP_DOWN_S = 0.8  # ramp at a normal end; at most 1 s is allowed
POST_STOP_RECORDING_S = 0.5  # recording of the deceleration after an early stop; assumed


class Experiment:
    """Experiment of one run: sweep, pitch experiment or manual throttle.

    Attributes:
        progress: receives the progress of a recording; a sweep has the operator's display.
        run: set before the first pulse; it must be closed.
        recorder, motors: of the run, set by `record`.
    """

    kind: ClassVar[Literal["sweep", "pitch", "live"]]
    recorder: Recorder
    motors: Motors

    def __init__(
        self, inputs: SweepInputs | RecordInputs, rig: Rig, progress: RunProgress | None = None
    ) -> None:
        self.inputs, self.rig = inputs, rig
        self.progress = progress or RunProgress()
        self.run: Run | None = None

    def prepare(self) -> Iterator[str]:
        """Check the inputs against the rig and yield the plan, before a bench is opened.

        Raises:
            InputError, PlanError: the value, the limit and the remedy.
        """
        raise NotImplementedError

    def check(self, bench: GuardedBench, operator: Operator) -> str:
        """Check the inputs against rig and device; return the text to arm, "" if armed before.

        Raises:
            InputError, PlanError: the value, the limit and the remedy; no motor was started.
        """
        raise NotImplementedError

    @contextmanager
    def open_stage(self, bench: GuardedBench) -> Iterator[None]:
        """Open the plate stage for the recording."""
        yield

    def describe_run(self, identity: DeviceInfo) -> tuple[str, str, dict[str, Any]]:
        """Return name, plan text and further metadata of a new run."""
        raise NotImplementedError

    def create_run(self, identity: DeviceInfo) -> Run:
        """Create the run folder, named by date and name without a path in the inputs.

        Raises:
            WouldOverwrite: the folder exists.
        """
        name, plan_text, facts = self.describe_run(identity)
        now = datetime.now().astimezone()
        path = self.inputs.out or free_run_path(self.inputs.runs, f"{now:%Y-%m-%d}", name)
        metadata = {
            "state": "running",
            "simulated": identity.simulated,
            "started": now.isoformat(timespec="seconds"),
            "operator": self.inputs.operator or user_name(),
            "address": identity.address,
            "device_id": identity.device_id,
            "device": {
                "firmware": identity.firmware,
                "protocol": identity.protocol,
                "rate_Hz": identity.rate_Hz,
                "watchdog_s": identity.watchdog_s,
                "limits": dict(identity.limits),
                "channels": {channel.name: channel.unit for channel in identity.channels},
                "channel_hash": identity.channel_hash,
                "orders_protected": identity.rejects_late_commands,
                "facts": dict(identity.facts),
            },
            "rig": asdict(self.rig),
            "calibration": None,
            "air": Air().facts(),
            "versions": {
                "benchtool": __version__,
                "python": platform.python_version(),
                "system": platform.platform(),
                **{
                    package: _version(package)
                    for package in ("numpy", "pandas", "pyarrow", "pyserial")
                },
            },
        }
        return Run.create(path, plan_text, metadata | facts)

    def display(self, operator: Operator) -> AbstractContextManager[RunProgress]:
        """Return the receiver of the progress."""
        return nullcontext(self.progress)

    def build_recorder(self, bench: GuardedBench, run: Run) -> Recorder:
        """Return the recorder of the run."""
        return Recorder(bench, run, self.progress)

    def measure(self) -> None:
        """Command the motors and record."""
        raise NotImplementedError

    def summarise(self) -> str:
        """Return the text of the last event of a complete run, at standstill."""
        raise NotImplementedError

    def hold(self) -> None:
        """Stop what moves other than motors; called after zero was commanded at an early end."""

    def summary(self, simulated: str = "") -> str:
        """Return the complete run in one line; `simulated` follows the number of points."""
        raise NotImplementedError

    @property
    def advice(self) -> str:
        """Next step for an incomplete run."""
        return ""

    def record(self, bench: GuardedBench, run: Run, progress: RunProgress | None = None) -> None:
        """Measure, ramp down, confirm standstill and close the run's files.

        At an early end zero is commanded first, then the reason is recorded and raised again; only
        a normal end ramps down. The caller closes the link.

        Raises:
            StandstillNotConfirmed: motors may still turn. Closing the guarded bench raises it too.
            BenchError, RunInterrupted: the reason of an early end.
        """
        self.progress = SafeProgress(progress)
        self.recorder = recorder = self.build_recorder(bench, run)
        self.motors = Motors(recorder, self.rig)
        try:
            try:
                self.measure()
                self.motors.ramp_to(self.motors.stop_us, RAMP_DOWN_S, "end")
                bench.stop()
                recorder.see_standstill()
                bench.require_standstill(ends_normally=True)
                recorder.record_event("ended", self.summarise())
                recorder.finish("ended")
            except BaseException as error:
                reported = _stop_immediately(recorder, error, self.hold)
                if reported is not error:
                    raise reported from error
                raise
        finally:
            recorder.close()


def _stop_immediately(
    recorder: Recorder, error: BaseException, hold: Callable[[], None]
) -> BaseException:
    """Command zero before anything else and return the error that ends the run.

    Errors of the later steps do not replace that error.
    """
    bench = recorder.bench
    with suppress(Exception):
        bench.stop()
    with suppress(Exception):
        hold()
    is_interrupt = isinstance(error, KeyboardInterrupt)
    reason = "stopped by Ctrl-C" if is_interrupt else str(error) or type(error).__name__
    with suppress(Exception):
        if unread := bench.pop_unread():
            recorder.store(unread, "end")
    with suppress(Exception):
        # Record the deceleration and the samples buffered in the link.
        if not isinstance(error, StandstillNotConfirmed):
            recorder.see_standstill(POST_STOP_RECORDING_S)
    if not isinstance(error, StandstillNotConfirmed):
        reason = bench.add_standstill_text(reason)
    with suppress(Exception):
        recorder.finish("stopped", reason)
    with suppress(Exception):
        recorder.record_event("stopped", reason)
    return recorder.rescue(error)


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
