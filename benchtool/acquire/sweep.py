"""Sweep of plate distance and throttle. Samples are written as they arrive."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict, replace
from math import isnan, nan, radians
from typing import Any

import numpy as np

from benchtool.acquire.bench_check import THRUST_FACTOR
from benchtool.acquire.calibration import find_calibration
from benchtool.acquire.check_plan import check_plan, expected_thrust_N
from benchtool.acquire.experiment import Experiment
from benchtool.acquire.inputs import SweepInputs, select_stage
from benchtool.acquire.measure import VisitChecks, VisitWatch, has_settled, measure
from benchtool.acquire.motors import TareResult, format_drift
from benchtool.acquire.operator import POLL_INTERVAL_S, Operator, arming_prompt, plan_text
from benchtool.acquire.plan import plan_to_toml
from benchtool.acquire.record import STEP_S, Recorder, RunProgress
from benchtool.acquire.resume import ResumeState, SweepStart, prepare_resume, require_same_device
from benchtool.acquire.visit_order import Visit, expected_duration_s, plan_visits
from benchtool.bench.bench import DeviceInfo
from benchtool.bench.guard import GuardedBench
from benchtool.bench.limit_check import CHECKS
from benchtool.bench.plate_check import PlateCheck
from benchtool.bench.stage.stage import PlateStage
from benchtool.bench.stop_requests import PauseRequested
from benchtool.core.channel import channel_family
from benchtool.core.errors import InputError, RunInterrupted
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.core.text import pluralize
from benchtool.data.calibration import format_age_warning
from benchtool.data.run.points import Point
from benchtool.data.run.run import Run

SETTLING_CHECK_INTERVAL_S = 0.1  # a tenth of the default settling window; assumed
PLATE_SETTLING_S = 0.2  # wait after the plate has arrived; assumed
MIN_SIGNAL_TO_NOISE = 10.0  # of a thrust that is compared with the expected one; assumed
MAX_ATTEMPTS = 3  # per point; a short dropout fails one attempt, a bad link all; assumed


class Sweep(Experiment):
    """Sweep of a resolved plan, or the rest of a run.

    Args:
        resume_state: of the resumed run, whose plan, rig and calibration are used.

    Attributes:
        stage, calibration: selected by `check`. The calibration is applied to the raw counts in
            points.csv; samples.csv stores the device values.
    """

    kind = "sweep"
    inputs: SweepInputs

    def __init__(
        self, inputs: SweepInputs, rig: Rig, resume_state: ResumeState | None = None
    ) -> None:
        super().__init__(inputs, rig)
        self.plan, self.resume_state = inputs.plan, resume_state
        self.start = SweepStart()
        self.stage = PlateStage()
        self.calibration = resume_state.calibration if resume_state else None
        self._first_anchor: Point | None = None
        self._moved_to: Visit | None = None
        self._plate_stage_z_m = nan
        self._last_point: Point | None = None
        self._tare: TareResult | None = None
        self._last_values: dict[str, float] = {}
        self._reported_channels: set[str] = set()
        self._is_thrust_reported = False

    def prepare(self) -> Iterator[str]:
        state, inputs = self.resume_state, self.inputs
        if state is not None and not (state.remaining or inputs.dry_run):
            prepare_resume(state)  # closes a complete run and raises
        done = state.done if state is not None else ()
        text = plan_text(self.plan, self.rig, check_plan(self.plan, self.rig), done)
        is_virtual = inputs.address.startswith("sim:")
        yield f"{text} bench time; a simulation runs faster" if is_virtual else text
        if inputs.dry_run:
            yield "dry run: no bench was opened"
        elif state is not None:
            self.start = prepare_resume(state)

    def check(self, bench: GuardedBench, operator: Operator) -> str:
        def ask(question: str) -> str:
            return operator.answer(question, lambda: bench.read_and_buffer(POLL_INTERVAL_S))

        plan, rig, inputs = self.plan, self.rig, self.inputs
        expected = check_plan(plan, rig, bench.identity.limits)
        if self.resume_state is not None:
            require_same_device(self.resume_state, bench.identity)
        else:
            self.calibration = find_calibration(inputs.calibration, bench.identity)
        self.stage = select_stage(inputs.stage, bench, rig, ask, plate=plan.plate.used)
        source = f"calibration {self.calibration.id}" if self.calibration else "the device only"
        return f"{arming_prompt(plan, rig, expected)}\nthrust calibrated by {source}"

    @contextmanager
    def open_stage(self, bench: GuardedBench) -> Iterator[None]:
        with bench.interruptible():
            self.stage.open()
        try:
            yield
        finally:
            self.stage.close()

    def create_run(self, identity: DeviceInfo) -> Run:
        return self.resume_state.run if self.resume_state else super().create_run(identity)

    def describe_run(self, identity: DeviceInfo) -> tuple[str, str, dict[str, Any]]:
        plan, calibration = self.plan, self.calibration
        facts = {
            "seed": plan.order.seed,
            "calibration": asdict(calibration) if calibration else None,
            "air": self.inputs.air.facts(),
            "visits": len(plan_visits(plan, self.rig)),
        }
        return plan.name, plan_to_toml(plan), facts

    def display(self, operator: Operator) -> AbstractContextManager[RunProgress]:
        return operator.display(self.rig.propulsion.radius_m if self.plan.plate.used else None)

    @property
    def advice(self) -> str:
        return f"resume with: benchtool sweep --resume {self.run.path}" if self.run else ""

    def build_recorder(self, bench: GuardedBench, run: Run) -> Recorder:
        channel_names = {channel.name for channel in bench.identity.channels}
        if "thrust_N" not in channel_names:
            raise InputError(
                "channel thrust_N is missing, which a sweep needs; check the channels of the device"
            )
        if self.calibration is not None and "thrust_raw" not in channel_names:
            raise InputError(
                f"channel thrust_raw is missing, which calibration {self.calibration.id} needs; "
                f"sweep with --calibration none"
            )
        start = self.start
        self.n_measured, self.n_failed, self.n_tares = len(start.done), 0, start.tares
        self.n_unsettled, self.n_suspect = start.unsettled, start.suspect
        self._plate_check = PlateCheck(bench.identity.channels, self.rig)
        return Recorder(bench, run, self.progress, start.time_s, start.link)

    def measure(self) -> None:
        visits = plan_visits(self.plan, self.rig)
        remaining = [visit for visit in visits if visit.point not in self.start.done]
        remaining_s = expected_duration_s(self.plan, self.rig, remaining)
        self.progress.started(len(visits), len(visits) - len(remaining), remaining_s)
        self._write_plate_metadata()
        if calibration_age := format_age_warning(self.recorder.run.metadata):
            self.recorder.record_event("calibration_old", calibration_age)
        for index, visit in enumerate(remaining):
            point = self._measure_with_pauses(visit)
            self.recorder.append_point(point)
            self.recorder.sync()
            self._last_point = point
            if point.kind != "failed":
                self.n_measured += 1
                self.n_unsettled += not point.settled
                self.n_suspect += point.suspect
            remaining_s = expected_duration_s(
                self.plan, self.rig, remaining[index + 1 :], self._moved_to
            )
            self.progress.measured(point, remaining_s)
            if point.settled and not self._is_thrust_reported:
                self._check_thrust(point, visit)
            if point.kind == "anchor":
                if drift := format_drift(self._first_anchor, point, self.plan.tare.drift_N):
                    self.recorder.record_event("drift", drift, visit.point)
                    self._tare = None
                self._first_anchor = self._first_anchor or point

    def _check_thrust(self, point: Point, visit: Visit) -> None:
        """Record an event, once, if thrust is far from the expected one and above noise."""
        expected_N = float(expected_thrust_N([visit], self.rig)[0][0])
        low_N, high_N = sorted((abs(point.thrust_N), abs(expected_N)))
        if high_N > max(THRUST_FACTOR * low_N, MIN_SIGNAL_TO_NOISE * point.thrust_sd_N):
            self._is_thrust_reported = True
            text = (
                f"thrust {point.thrust_N:.3g} N, expected {expected_N:.3g} N: check the "
                f"calibration (calibrate, or --calibration none), the rig and the propeller"
            )
            self.recorder.record_event("thrust", text, visit.point)

    def _measure_with_pauses(self, visit: Visit) -> Point:
        """Return the point of a visit; repeat it after a pause."""
        reason = "paused"
        while True:
            try:
                self._wait_while_paused(reason)
                self.progress.visiting(visit)
                return self._measure_point(visit)
            except PauseRequested as pause:
                # The device has latched zero; the next pulse arms it again.
                self.recorder.bench.stop()
                reason = str(pause)

    def _wait_while_paused(self, reason: str) -> None:
        if not self.progress.is_paused():
            return
        self.motors.stand_still(self.plan.tare.stop_timeout_s, "rest")
        self.recorder.record_event("paused", f"{reason}; motors at zero")
        pause_start_s = self.recorder.now_s
        while self.progress.is_paused():
            self.recorder.read("rest")
        pause_s = self.recorder.now_s - pause_start_s
        self.recorder.record_event("went_on", f"resumed after {pause_s:.0f} s")

    def _measure_point(self, visit: Visit) -> Point:
        """Return the point of a visit; kind "failed" if no attempt had good samples."""
        self._tare_if_due()
        self.motors.cool_down_if_needed(self.plan.rest, self._last_point)
        self._move_plate(visit)
        command_pwm_us = np.array(visit.pwm_us)
        self.motors.ramp_to(command_pwm_us, self.plan.throttle.ramp_s, "ramp", visit.point)
        assert self._tare is not None
        has_new_pwm = self._last_point and self._last_point.pwm_us != visit.pwm_us
        checks = VisitChecks(
            rates_Hz=self._expected_rates_Hz(visit),
            sensors=self.rig.sensors,
            seconds=self.plan.sample_s,
            share=self.plan.sample_share,
            before=self._last_values if has_new_pwm else {},
        )
        ramp_end_s = self.recorder.now_s
        for attempt in range(1, MAX_ATTEMPTS + 1):
            watch = VisitWatch(checks, self.recorder.new_samples(), ramp_end_s)
            settled = self._wait_until_settled(visit, watch)
            samples = self._read_samples(visit, watch)
            problem = watch.problem
            if problem is None and (shortage := checks.shortage(samples)):
                problem = ("few_samples", shortage)
            for channel_name in watch.remarks.keys() - self._reported_channels:
                self._reported_channels.add(channel_name)  # optional channel: one event per run
                text = f"point {visit.point}: {watch.remarks[channel_name]}"
                self.recorder.record_event("frozen", text, visit.point)
            if problem is None:
                break
            event, reason = problem
            outcome = "measured again" if attempt < MAX_ATTEMPTS else "marked as failed"
            self.recorder.record_event(
                event, f"point {visit.point}: {reason}; {outcome}", visit.point
            )
        point, events = measure(
            samples, visit, self._plate_stage_z_m, self._tare, self.rig.sensors, settled
        )
        if problem is not None:
            self.n_failed += 1
            time_s = point.time_s if len(samples) else self.recorder.now_s
            elapsed_s = time_s - self._tare.time_s
            return replace(point, kind="failed", settled=False, time_s=time_s, elapsed_s=elapsed_s)
        for event, text in events:
            self.recorder.record_event(event, text, visit.point)
        self._last_values = _find_last_values(samples, checks.rates_Hz)
        if not isnan(self._plate_stage_z_m):  # nan without a stage
            position_error = self._plate_check.check_position(
                self._plate_stage_z_m, point.plate_read_z_m, self.stage.position_uncertainty_m
            )
            if position_error:
                raise position_error
        return point

    def _expected_rates_Hz(self, visit: Visit) -> dict[str, float]:
        """Return the expected rates of the checked channels; rpm only of driven rotors."""
        assert self._tare is not None
        device_info = self.recorder.bench.identity
        channel_names = [channel.name for channel in device_info.channels]
        # Fallback for devices that report no rates: those of the last tare.
        device_rates_Hz = dict(zip(channel_names, device_info.channel_rates_Hz, strict=False))
        rates_Hz = {**self._tare.rates_Hz, **device_rates_Hz}
        driven_rotors = np.flatnonzero(visit.pwm_us > self.motors.stop_us) + 1
        driven_channels = {f"rpm{rotor}" for rotor in driven_rotors}
        return {
            name: min(rates_Hz[name], device_info.rate_Hz)
            for family in CHECKS
            for name in channel_names
            if channel_family(name) == family and (family != "rpm" or name in driven_channels)
        }

    def _write_plate_metadata(self) -> None:
        """Write the stage and the source of the plate distance to the metadata."""
        is_manual = self.stage.facts["stage"] == "hand"
        metadata = dict(self.stage.facts) | {"measured": self._plate_check.is_measured}
        metadata |= {"used": self.plan.plate.used, "tolerance_m": self._plate_check.tolerance_m}
        self.recorder.run.update_metadata(plate=metadata)
        if remark := metadata.get("remark"):
            self.recorder.record_event("plate", str(remark))
        if metadata["stage"] == "none":
            self.recorder.record_event("plate", "no plate is moved: throttle alone is visited")
        elif not self._plate_check.is_measured:
            source = "typed by the operator" if is_manual else "commanded"
            text = f"no channel reads where the plate stands: distances are {source}, not measured"
            self.recorder.record_event("plate", text)

    def _tare_if_due(self) -> None:
        interval_s = 60.0 * self.plan.tare.every_minutes
        if self._tare is not None:
            age_s = self.recorder.now_s - self._tare.time_s
            if not interval_s or age_s < interval_s:
                return
        self._tare = self.motors.tare(self.plan.tare, self.calibration)
        self.n_tares += 1

    def _move_plate(self, visit: Visit) -> None:
        """Wait for standstill and move the plate; no-op if it is already there."""
        if self._moved_to is not None and visit.position == self._moved_to.position:
            return

        def pause(seconds: float) -> None:
            self.recorder.collect("move", seconds)

        self.motors.stand_still(self.plan.tare.stop_timeout_s, "move")
        self._moved_to = None
        try:
            self._plate_stage_z_m = self.stage.move(
                visit.target_z_m, visit.target_x_m, radians(visit.target_tilt_deg), pause
            )
        except PauseRequested:
            self.stage.hold()
            raise
        self.recorder.collect("move", PLATE_SETTLING_S)
        self._moved_to, self._last_values = visit, {}

    def _wait_until_settled(self, visit: Visit, watch: VisitWatch) -> bool:
        """Wait until thrust and speeds have settled; return False on timeout or bad samples.

        A timeout is recorded as an event.
        """
        settle, recorder = self.plan.settle, self.recorder
        driven = np.flatnonzero(visit.pwm_us > self.motors.stop_us)
        start_s = last_check_s = recorder.bench.now_s()
        while True:
            if watch.update(recorder.read("settle", visit.point)):
                return False
            now_s = recorder.bench.now_s()
            is_check_due = now_s - last_check_s >= SETTLING_CHECK_INTERVAL_S
            if is_check_due and now_s - start_s >= settle.window_s:
                last_check_s = now_s
                if has_settled(watch.samples.recording(), driven, settle):
                    return True
            if now_s - start_s >= settle.timeout_s:
                text = (
                    f"point {visit.point} has not settled within {settle.timeout_s:g} s; measured "
                    f"anyway"
                )
                recorder.record_event("settle_timeout", text, visit.point)
                return False

    def _read_samples(self, visit: Visit, watch: VisitWatch) -> Recording:
        """Return the samples of a point; stop early when the watch reports a problem."""
        start, bench = len(watch.samples), self.recorder.bench
        end_s = bench.now_s() + self.plan.sample_s
        while watch.problem is None and (remaining_s := end_s - bench.now_s()) > 1e-9:
            watch.update(self.recorder.read("sample", visit.point, min(STEP_S, remaining_s)))
        return watch.samples.recording(start)

    def summarise(self) -> str:
        """Return the text of the last event.

        Raises:
            RunInterrupted: at least one point has failed.
        """
        if self.n_failed:
            raise RunInterrupted(
                f"{pluralize(self.n_failed, 'visit')} failed ({self.n_measured} measured): "
                f"samples too few, late or frozen; check the link and the sensors (see "
                f"events.jsonl), then repeat the failed visits with benchtool sweep --resume"
            )
        suspect = f", {self.n_suspect} of them suspect" if self.n_suspect else ""
        return f"all is measured: {pluralize(self.n_measured, 'visit')}{suspect}"

    def hold(self) -> None:
        self.stage.hold()

    def summary(self, simulated: str = "") -> str:
        suspect = f"{self.n_suspect} suspect, " if self.n_suspect else ""
        quality = self.recorder.quality
        return (
            f"{pluralize(self.n_measured, 'point')}{simulated}, {self.n_unsettled} not settled, "
            f"{suspect}{pluralize(self.n_tares, 'tare')}, {pluralize(quality.samples, 'sample')}, "
            f"{quality.lost} lost"
        )


def _find_last_values(samples: Recording, names: Iterable[str]) -> dict[str, float]:
    """Return the last finite value of each channel; channels without one are left out."""
    columns = {name: samples.column(name) for name in names}
    finite = {name: column[np.isfinite(column)] for name, column in columns.items()}
    return {name: float(values[-1]) for name, values in finite.items() if len(values)}
