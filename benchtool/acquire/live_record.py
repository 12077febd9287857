"""Record a bench while motors are turned by hand: an ordinary run, with a point where one settles.

Every pulse that is held makes points: once thrust and speeds have settled, each span of the plan's
length is one repeat. A level that is left before its first span has ended makes none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

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
from benchtool.core.plural import pluralize
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.data.calibration import Calibration
from benchtool.data.run.run import Run

READ_TIMEOUT_S = 0.02  # longest read between two looks at the hand on the throttle
POLL_INTERVAL_S = 0.1  # how often settling is tested; assumed, as in a sweep


def live_plan(name: str, rig: Rig) -> Plan:
    """Return what a live recording takes from a plan: tare, settling and length of a point."""
    plan = Plan(name=name).resolved(rig)
    return replace(plan, plate=PlatePart(used=False), throttle=replace(plan.throttle, pwm_us=()))


@dataclass(frozen=True, slots=True)
class LiveSummary:
    """Count what a live recording holds."""

    points: int
    samples: int
    lost: int
    seconds: float

    def text(self) -> str:
        """Return it in words."""
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
    """Tare, then record until `turn` returns False, and end the run as `run_to_end` says.

    Args:
        turn: commands what the hand on the throttle asks for; called before every read.
        calibration: applied to raw counts in points.csv.

    Raises:
        StandstillNotSeen: motors may still turn; leaving the guarded bench raises this too.
        BenchError, RunStopped: why it ended early.
    """
    recorder = Recorder(bench, run, SafeProgress(progress))
    motors = Motors(recorder, rig)
    live = _Live(recorder, rig, plan, calibration, progress or RunProgress())

    def measure_all() -> None:
        live.tared = tare(recorder, motors, plan.tare, rig)
        recorder.append_point(tare_point(live.tared, rig.n_rotors))
        while turn():
            live.read()

    def summarise() -> tuple[LiveSummary, str]:
        quality = recorder.quality
        summary = LiveSummary(live.points, quality.samples, quality.lost, recorder.now_s)
        return summary, summary.text()

    return run_to_end(recorder, motors, measure_all, summarise, lambda: None)


class _Live:
    """Make points of the levels that are held: a settled span after another."""

    def __init__(
        self,
        recorder: Recorder,
        rig: Rig,
        plan: Plan,
        calibration: Calibration | None,
        progress: RunProgress,
    ) -> None:
        self.points = 0
        self.tared: TareResult | None = None
        self._recorder, self._rig, self._plan = recorder, rig, plan
        self._calibration, self._progress = calibration, progress
        self._pulses_us = np.full(rig.n_rotors, rig.propulsion.pwm_stop_us)
        self._stop_us = self._pulses_us
        self._number = 0
        self._parts: list[Readings] = []
        self._phase, self._settled = "settle", False
        self._begun_s = self._looked_s = 0.0
        self._visits: dict[tuple[float, ...], int] = {}

    def read(self) -> None:
        """Read on; append a point where its span is complete."""
        recorder, pulses_us = self._recorder, self._recorder.bench.pwm_us
        turning = np.flatnonzero(pulses_us > self._stop_us)
        if not np.array_equal(pulses_us, self._pulses_us):
            self._pulses_us = pulses_us
            self._number += 1
            self._begin("settle")
        phase = self._phase if len(turning) else "rest"
        readings = recorder.read(phase, self._number if len(turning) else 0, READ_TIMEOUT_S)
        now_s = recorder.now_s
        if now_s - self._looked_s >= POLL_INTERVAL_S:
            self._looked_s = now_s
        if not len(turning):
            return
        self._parts.append(readings)
        held_s = now_s - self._begun_s
        if phase == "sample" and held_s >= self._plan.sample_s:
            self._append(recorder.joined(self._parts))
            self._number += 1
            self._begin("sample")
        elif phase == "settle" and held_s >= self._plan.settle.window_s:
            self._settled = self._looked_s == now_s and self._has_settled(turning)
            if self._settled or held_s >= self._plan.settle.timeout_s:
                self._begin("sample")

    def _begin(self, phase: str) -> None:
        self._parts, self._phase, self._begun_s = [], phase, self._recorder.now_s

    def _has_settled(self, turning: NDArray[np.intp]) -> bool:
        plan, seen = self._plan.settle, self._recorder.joined(self._parts)
        names = ["thrust_N", *(f"rpm{rotor + 1}" for rotor in turning)]
        channels = [seen.column(name) for name in names if name in seen]
        return is_settled(seen.column("time_s"), channels, plan.window_s, plan.slope_per_s)

    def _append(self, samples: Recording) -> None:
        assert self.tared is not None
        place = self._place(samples)
        pulses_us = tuple(self._pulses_us.tolist())
        key = (*pulses_us, *(round(number, 3) for number in (place.z_m, place.x_m, place.tilt_deg)))
        self._visits[key] = self._visits.get(key, 0) + 1
        number = list(self._visits).index(key) + 1
        self.points += 1
        setting = Setting(number, place, max(pulses_us), pulses_us)
        kind: Literal["measure", "reference"] = "reference" if place.parked else "measure"
        visit = Visit(self._number, kind, setting, self._visits[key])
        point, notes = measure(
            samples, visit, place.z_m, self.tared, self._calibration, self._rig.sensors,
            self._settled,
        )  # fmt: skip
        for event, text in notes:
            self._recorder.note(event, text, visit.point)
        self._recorder.append_point(point)
        self._recorder.sync()
        self._progress.measured(point, 0.0)

    def _place(self, samples: Recording) -> PlatePosition:
        """Return where the plate was; where none is measured, it counts as parked."""
        z_m, x_m, tilt_deg = (
            average(samples.column(name)).mean if name in samples else 0.0
            for name in ("plate_z_m", "plate_x_m", "plate_tilt_deg")
        )
        park_m = self._rig.plate.z_park_m
        near = "plate_z_m" in samples and z_m < park_m - plate_tolerance_m(self._rig)
        return PlatePosition(z_m if near else park_m, x_m, tilt_deg, parked=not near)
