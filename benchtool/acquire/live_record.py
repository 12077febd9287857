"""Live recording with manual throttle, as a run with points at settled levels.

After thrust and speeds have settled at a level, every sampling time of the plan is one repeat. A
level that changes before its first sampling time ends has no point.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchtool.acquire.average import average, is_settled
from benchtool.acquire.measure import measure
from benchtool.acquire.motors import Motors, run_to_end
from benchtool.acquire.plan import Plan, PlatePart
from benchtool.acquire.record import Recorder, RunProgress, SafeProgress
from benchtool.acquire.tare import TareResult, tare, tare_point
from benchtool.acquire.visit_order import PlatePosition, Setting, Visit
from benchtool.bench.bench import Readings
from benchtool.bench.guard import GuardedBench
from benchtool.bench.plate_check import plate_tolerance_m
from benchtool.core.choices import PointKind
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.core.text import pluralize
from benchtool.data.calibration import Calibration
from benchtool.data.run.run import Run

READ_TIMEOUT_S = 0.02  # maximum read between two polls of the throttle
POLL_INTERVAL_S = 0.1  # how often settling is tested; assumed, as in a sweep


def live_plan(name: str, rig: Rig) -> Plan:
    """Return the plan of a live recording: tare, settling and sampling time."""
    plan = Plan(name=name).resolved(rig)
    return replace(plan, plate=PlatePart(used=False), throttle=replace(plan.throttle, pwm_us=()))


@dataclass(frozen=True, slots=True)
class LiveSummary:
    """Summary of a live recording."""

    points: int
    samples: int
    lost: int
    seconds: float

    def text(self) -> str:
        """Return the summary as one line."""
        return (
            f"{self.seconds:.0f} s, {pluralize(self.points, 'point')}, "
            f"{pluralize(self.samples, 'sample')}, {self.lost} lost"
        )


def record_live(
    bench: GuardedBench,
    rig: Rig,
    plan: Plan,
    run: Run,
    progress: RunProgress | None,
    turn: Callable[[], bool],
    calibration: Calibration | None = None,
) -> LiveSummary:
    """Tare, record until `turn` returns False, and end the run with `run_to_end`.

    Args:
        turn: callback that commands the manual throttle; called before every read.
        calibration: applied to raw counts in points.csv.

    Raises:
        StandstillNotConfirmed: motors may still turn; closing the guarded bench raises it too.
        BenchError, RunInterrupted: reason of an early end.
    """
    recorder = Recorder(bench, run, SafeProgress(progress))
    motors = Motors(recorder, rig)
    live = _Live(recorder, rig, plan, calibration, progress or RunProgress())

    def measure_all() -> None:
        live.tare_result = tare(recorder, motors, plan.tare, rig)
        recorder.append_point(tare_point(live.tare_result, rig.n_rotors))
        while turn():
            live.read()

    def summarise() -> tuple[LiveSummary, str]:
        quality = recorder.quality
        summary = LiveSummary(live.points, quality.samples, quality.lost, recorder.now_s)
        return summary, summary.text()

    return run_to_end(recorder, motors, measure_all, summarise, lambda: None)


class _Live:
    """Points from constant throttle levels, one per settled sampling time."""

    def __init__(
        self,
        recorder: Recorder,
        rig: Rig,
        plan: Plan,
        calibration: Calibration | None,
        progress: RunProgress,
    ) -> None:
        self.points = 0
        self.tare_result: TareResult | None = None
        self._recorder, self._rig, self._plan = recorder, rig, plan
        self._calibration, self._progress = calibration, progress
        self._pulses_us = np.full(rig.n_rotors, rig.propulsion.pwm_stop_us)
        self._stop_us = self._pulses_us
        self._number = 0
        self._parts: list[Readings] = []
        self._phase, self._settled = "settle", False
        self._start_s = self._checked_s = 0.0
        self._visits: dict[tuple[float, ...], int] = {}

    def read(self) -> None:
        """Read samples; append a point when its sampling time is complete."""
        recorder, pulses_us = self._recorder, self._recorder.bench.pwm_us
        driven = np.flatnonzero(pulses_us > self._stop_us)
        if not np.array_equal(pulses_us, self._pulses_us):
            self._pulses_us = pulses_us
            self._number += 1
            self._begin("settle")
        phase = self._phase if len(driven) else "rest"
        readings = recorder.read(phase, self._number if len(driven) else 0, READ_TIMEOUT_S)
        now_s = recorder.now_s
        if now_s - self._checked_s >= POLL_INTERVAL_S:
            self._checked_s = now_s
        if not len(driven):
            return
        self._parts.append(readings)
        level_s = now_s - self._start_s
        if phase == "sample" and level_s >= self._plan.sample_s:
            self._append(recorder.concatenate(self._parts))
            self._number += 1
            self._begin("sample")
        elif phase == "settle" and level_s >= self._plan.settle.window_s:
            self._settled = self._checked_s == now_s and self._has_settled(driven)
            if self._settled or level_s >= self._plan.settle.timeout_s:
                self._begin("sample")

    def _begin(self, phase: str) -> None:
        self._parts, self._phase, self._start_s = [], phase, self._recorder.now_s

    def _has_settled(self, driven: NDArray[np.intp]) -> bool:
        plan, samples = self._plan.settle, self._recorder.concatenate(self._parts)
        names = ["thrust_N", *(f"rpm{rotor + 1}" for rotor in driven)]
        channels = [samples.column(name) for name in names if name in samples]
        return is_settled(samples.column("time_s"), channels, plan.window_s, plan.slope_per_s)

    def _append(self, samples: Recording) -> None:
        assert self.tare_result is not None
        position = self._plate_position(samples)
        pulses_us = tuple(self._pulses_us.tolist())
        key = (
            *pulses_us,
            *(round(number, 3) for number in (position.z_m, position.x_m, position.tilt_deg)),
        )
        self._visits[key] = self._visits.get(key, 0) + 1
        number = list(self._visits).index(key) + 1
        self.points += 1
        setting = Setting(number, position, max(pulses_us), pulses_us)
        kind: PointKind = "reference" if position.parked else "measure"
        visit = Visit(self._number, kind, setting, self._visits[key])
        point, events = measure(
            samples, visit, position.z_m, self.tare_result, self._calibration, self._rig.sensors,
            self._settled,
        )  # fmt: skip
        for event, text in events:
            self._recorder.record_event(event, text, visit.point)
        self._recorder.append_point(point)
        self._recorder.sync()
        self._progress.measured(point, 0.0)

    def _plate_position(self, samples: Recording) -> PlatePosition:
        """Return the plate position; parked if it is not measured."""
        z_m, x_m, tilt_deg = (
            average(samples.column(name)).mean if name in samples else 0.0
            for name in ("plate_z_m", "plate_x_m", "plate_tilt_deg")
        )
        park_m = self._rig.plate.z_park_m
        is_near = "plate_z_m" in samples and z_m < park_m - plate_tolerance_m(self._rig)
        return PlatePosition(z_m if is_near else park_m, x_m, tilt_deg, parked=not is_near)
