"""Live recording with manual throttle, as a run with points at settled levels.

After thrust and speeds have settled at a level, every sampling time of the plan is one repeat. A
level that changes before its first sampling time ends has no point.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from benchtool.acquire.average import average
from benchtool.acquire.calibration import find_calibration
from benchtool.acquire.experiment import Experiment
from benchtool.acquire.inputs import SweepInputs
from benchtool.acquire.measure import has_settled, measure
from benchtool.acquire.motors import TareResult
from benchtool.acquire.operator import Operator
from benchtool.acquire.plan import Plan, PlatePart, plan_to_toml
from benchtool.acquire.record import RunProgress
from benchtool.acquire.visit_order import Visit
from benchtool.bench.bench import DeviceInfo
from benchtool.bench.guard import GuardedBench
from benchtool.bench.plate_check import plate_tolerance_m
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.core.text import pluralize
from benchtool.data.calibration import Calibration

READ_TIMEOUT_S = 0.02  # maximum read between two polls of the throttle
POLL_INTERVAL_S = 0.1  # how often settling is tested; assumed, as in a sweep


def live_plan(name: str, rig: Rig) -> Plan:
    """Return the plan of a live recording: tare, settling and sampling time."""
    plan = Plan(name=name).resolved(rig)
    return replace(plan, plate=PlatePart(used=False), throttle=replace(plan.throttle, pwm_us=()))


class LiveRecording(Experiment):
    """Recording under manual throttle, with points from constant levels.

    Args:
        turn: callback that commands the manual throttle; called before every read, until it
            returns False.
    """

    kind = "live"
    inputs: SweepInputs

    def __init__(
        self, inputs: SweepInputs, rig: Rig, progress: RunProgress, turn: Callable[[], bool]
    ) -> None:
        super().__init__(inputs, rig, progress)
        self.plan, self.n_points, self.seconds = inputs.plan, 0, 0.0
        self.calibration: Calibration | None = None
        self._turn = turn
        self._tare: TareResult | None = None
        self._pulses_us = np.full(rig.n_rotors, rig.propulsion.pwm_stop_us)
        self._number = 0
        self._phase, self._settled = "settle", False
        self._start_s = self._checked_s = 0.0
        self._visits: dict[tuple[float, ...], int] = {}

    def check(self, bench: GuardedBench, operator: Operator) -> str:
        self.calibration = find_calibration(None, bench.identity)
        return ""

    def describe_run(self, identity: DeviceInfo) -> tuple[str, str, dict[str, Any]]:
        calibration = asdict(self.calibration) if self.calibration else None
        facts = {"calibration": calibration, "experiment": "live"}
        return self.plan.name, plan_to_toml(self.plan), facts

    def measure(self) -> None:
        self._tare = self.motors.tare(self.plan.tare, self.calibration)
        self._begin("settle")
        while self._turn():
            self._read()

    def summarise(self) -> str:
        self.seconds = self.recorder.now_s
        return self.summary()

    def summary(self, simulated: str = "") -> str:
        quality = self.recorder.quality
        return (
            f"{self.seconds:.0f} s, {pluralize(self.n_points, 'point')}{simulated}, "
            f"{pluralize(quality.samples, 'sample')}, {quality.lost} lost"
        )

    def _read(self) -> None:
        """Read samples; append a point when its sampling time is complete."""
        recorder, pulses_us = self.recorder, self.recorder.bench.pwm_us
        driven = np.flatnonzero(pulses_us > self.motors.stop_us)
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
        self._samples.append(readings)
        level_s = now_s - self._start_s
        if phase == "sample" and level_s >= self.plan.sample_s:
            self._append(self._samples.recording())
            self._number += 1
            self._begin("sample")
        elif phase == "settle" and level_s >= self.plan.settle.window_s:
            is_checked, samples = self._checked_s == now_s, self._samples.recording()
            self._settled = is_checked and has_settled(samples, driven, self.plan.settle)
            if self._settled or level_s >= self.plan.settle.timeout_s:
                self._begin("sample")

    def _begin(self, phase: str) -> None:
        self._samples, self._phase = self.recorder.new_samples(), phase
        self._start_s = self.recorder.now_s

    def _append(self, samples: Recording) -> None:
        assert self._tare is not None
        position = self._plate_position(samples)
        pulses_us = tuple(self._pulses_us.tolist())
        key = (*pulses_us, *(round(number, 3) for number in position[:3]))
        self._visits[key] = self._visits.get(key, 0) + 1
        self.n_points += 1
        visit = Visit(
            *position,
            setting=list(self._visits).index(key) + 1,
            pwm_us=pulses_us,
            point=self._number,
            kind="reference" if position[3] else "measure",
            repeat=self._visits[key],
        )
        point, events = measure(
            samples, visit, visit.target_z_m, self._tare, self.rig.sensors, self._settled
        )
        for event, text in events:
            self.recorder.record_event(event, text, visit.point)
        self.recorder.append_point(point)
        self.recorder.sync()
        self.progress.measured(point, 0.0)

    def _plate_position(self, samples: Recording) -> tuple[float, float, float, bool]:
        """Return the position of a visit; parked if the distance is not measured."""
        z_m, x_m, tilt_deg = (
            average(samples.column(name)).mean if name in samples else 0.0
            for name in ("plate_z_m", "plate_x_m", "plate_tilt_deg")
        )
        park_m = self.rig.plate.z_park_m
        is_near = "plate_z_m" in samples and z_m < park_m - plate_tolerance_m(self.rig)
        return z_m if is_near else park_m, x_m, tilt_deg, not is_near
