"""Run a sweep: visit after visit, every sample on the disk, and a safe end however it ends."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from math import isnan, nan, radians

import numpy as np

from benchtool.acquire.average import is_settled
from benchtool.acquire.measure import measure
from benchtool.acquire.motors import Motors, cool_down_if_needed, run_to_end
from benchtool.acquire.plan import Plan
from benchtool.acquire.record import STEP_S, LinkQuality, Recorder, RunProgress, SafeProgress
from benchtool.acquire.tare import TareResult, format_drift, tare, tare_point
from benchtool.acquire.visit_checks import VisitChecks, VisitWatch
from benchtool.acquire.visit_order import PlatePosition, Visit, expected_duration_s, plan_visits
from benchtool.bench.bench import Readings
from benchtool.bench.channel_limits import CHECKS
from benchtool.bench.guard import GuardedBench
from benchtool.bench.plate_check import PlateCheck
from benchtool.bench.stage.stage import PlateStage
from benchtool.bench.wrappers import PauseRequested
from benchtool.core.channel import channel_family
from benchtool.core.errors import InputError, RunInterrupted
from benchtool.core.plural import pluralize
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.data.calibration import Calibration, age_text
from benchtool.data.run.points import Point
from benchtool.data.run.run import Run

SETTLE_CHECK_S = 0.1  # how often settling is tested; assumed, a tenth of the usual window
MAX_ATTEMPTS = 3  # measurements of a visit with too few, late or frozen samples; assumed
PLATE_SETTLING_S = 0.2  # time for a plate that has just arrived to come to rest; assumed


@dataclass(frozen=True, slots=True)
class SweepStart:
    """Say where a sweep begins: at the start, or behind what a resumed run has on disk.

    Attributes:
        time_s: time of the run at which this part begins.
        unsettled, suspect, tares: how many of the visits that are done, and how many tares.
    """

    done: frozenset[int] = frozenset()
    time_s: float = 0.0
    unsettled: int = 0
    suspect: int = 0
    tares: int = 0
    link: LinkQuality = field(default_factory=LinkQuality)


@dataclass(frozen=True, slots=True)
class SweepSummary:
    """Say what a sweep did, with all parts of a resumed one."""

    measured: int
    unsettled: int
    suspect: int
    tares: int
    duration_s: float
    samples: int
    lost: int

    def text(self, simulated: str = "") -> str:
        """Return it in words.

        Args:
            simulated: stands behind the points.
        """
        suspect = f"{self.suspect} suspect, " if self.suspect else ""
        return (
            f"{pluralize(self.measured, 'point')}{simulated}, {self.unsettled} not settled, "
            f"{suspect}{pluralize(self.tares, 'tare')}, {pluralize(self.samples, 'sample')}, "
            f"{self.lost} lost"
        )


def run_sweep(
    bench: GuardedBench,
    stage: PlateStage,
    plan: Plan,
    rig: Rig,
    run: Run,
    progress: RunProgress | None = None,
    *,
    calibration: Calibration | None = None,
    start: SweepStart | None = None,
    waits: Callable[[], bool] = lambda: False,
) -> SweepSummary:
    """Run a resolved and checked plan on an open bench, and end it as `run_to_end` says.

    Args:
        calibration: applied to raw counts in points.csv; samples.csv stores what the device sent.
        waits: called before every visit; while it returns True, motors stand still and the bench
            is read on.

    Raises:
        StandstillNotSeen: motors may still turn; leaving the guarded bench raises this too.
        BenchError, RunInterrupted: why it ended early.
    """
    channels = {channel.name for channel in bench.identity.channels}
    if "thrust_N" not in channels:
        raise InputError("the bench streams no thrust_N, so there is nothing to sweep; check it")
    if calibration is not None and "thrust_raw" not in channels:
        raise InputError(
            f"calibration {calibration.id} needs raw counts, but the device streams no thrust_raw; "
            f"sweep with --calibration none"
        )
    safe = SafeProgress(progress)
    sweep = _Sweep(bench, stage, plan, rig, run, safe, calibration, start or SweepStart(), waits)
    return run_to_end(sweep.recorder, sweep.motors, sweep.visit_all, sweep.summarise, stage.hold)


@dataclass
class _Sweep:
    """Hold what one sweep remembers between its visits."""

    bench: GuardedBench
    stage: PlateStage
    plan: Plan
    rig: Rig
    run: Run
    progress: RunProgress
    calibration: Calibration | None
    start: SweepStart
    waits: Callable[[], bool]

    def __post_init__(self) -> None:
        start = self.start
        self.recorder = Recorder(self.bench, self.run, self.progress, start.time_s, start.link)
        self.motors = Motors(self.recorder, self.rig)
        self._first_anchor: Point | None = None
        self._place: PlatePosition | None = None
        self._reached_m = nan
        self._plate = PlateCheck(self.bench.identity.channels, self.rig)
        self._last: Point | None = None
        self._tared: TareResult | None = None
        self._measured, self._failed = len(start.done), 0
        self._unsettled, self._suspect, self._tares = start.unsettled, start.suspect, start.tares
        self._shown: dict[str, float] = {}
        self._remarked: set[str] = set()

    def visit_all(self) -> None:
        visits = plan_visits(self.plan, self.rig)
        left = [visit for visit in visits if visit.point not in self.start.done]
        left_s = expected_duration_s(self.plan, self.rig, left)
        self.progress.started(len(visits), len(visits) - len(left), left_s)
        self._record_plate()
        if old := age_text(self.run.metadata):
            self.recorder.note("calibration_old", old)
        for index, visit in enumerate(left):
            point = self._visit_with_pauses(visit)
            self.recorder.append_point(point)
            self.recorder.sync()
            self._last = point
            if point.kind != "failed":
                self._measured += 1
                self._unsettled += not point.settled
                self._suspect += point.suspect
            left_s = expected_duration_s(self.plan, self.rig, left[index + 1 :], self._place)
            self.progress.measured(point, left_s)
            if point.kind == "anchor":
                if why := format_drift(self._first_anchor, point, self.plan.tare.drift_N):
                    self.recorder.note("drift", why, visit.point)
                    self._tared = None
                self._first_anchor = self._first_anchor or point

    def _visit_with_pauses(self, visit: Visit) -> Point:
        """Return the point of a visit; a visit that is paused half-way is repeated."""
        reason = "paused"
        while True:
            try:
                self._wait(reason)
                self.progress.visiting(visit)
                return self._visit(visit)
            except PauseRequested as pause:
                self.bench.stop()  # the device has latched zero; the next pulse arms it again
                reason = str(pause)

    def _wait(self, reason: str) -> None:
        if not self.waits():
            return
        self.motors.stand_still(self.plan.tare.stop_timeout_s, "rest")
        self.recorder.note("paused", f"{reason}; motors at zero")
        begun_s = self.recorder.now_s
        while self.waits():
            self.recorder.read("rest")
        self.recorder.note("went_on", f"went on after {self.recorder.now_s - begun_s:.0f} s")

    def _visit(self, visit: Visit) -> Point:
        self._tare_if_due()
        cool_down_if_needed(self.recorder, self.motors, self.plan.rest, self._last)
        self._go_to(visit.setting.place)
        pulses_us = np.array(visit.setting.pwm_us)
        self.motors.ramp_to(pulses_us, self.plan.throttle.ramp_s, "ramp", visit.point)
        assert self._tared is not None
        checks = VisitChecks(
            rates_Hz=self._rates_Hz(visit),
            sensors=self.rig.sensors,
            seconds=self.plan.sample_s,
            share=self.plan.sample_share,
            before=self._shown if self._last and self._last.pwm_us != visit.setting.pwm_us else {},
        )
        commanded_s = self.recorder.now_s
        for attempt in range(1, MAX_ATTEMPTS + 1):
            watch = VisitWatch(checks, self.recorder.joined, commanded_s)
            settled = self._settle(visit, watch)
            samples = self._sampled(visit, watch)
            problem = watch.problem
            if problem is None and (short := checks.shortage(samples)):
                problem = ("few_samples", short)
            for name in watch.remarks.keys() - self._remarked:
                self._remarked.add(name)  # once a run: no point needs it
                text = f"point {visit.point}: {watch.remarks[name]}"
                self.recorder.note("frozen", text, visit.point)
            if problem is None:
                break
            then = "measured again" if attempt < MAX_ATTEMPTS else "marked as failed"
            self.recorder.note(
                problem[0], f"point {visit.point}: {problem[1]}; {then}", visit.point
            )
        point, notes = measure(
            samples,
            visit,
            self._reached_m,
            self._tared,
            self.calibration,
            self.rig.sensors,
            settled,
            self.recorder.now_s,
        )
        if problem is not None:
            self._failed += 1
            return replace(point, kind="failed", settled=False)
        for event, text in notes:
            self.recorder.note(event, text, visit.point)
        self._shown = _last_values(samples, checks.rates_Hz)
        more_m = self.stage.measures_to_m
        # Without a stage no place is known that the plate could leave.
        known = not isnan(self._reached_m)
        if known and (crept := self._plate.crept(self._reached_m, point.plate_read_z_m, more_m)):
            raise crept
        return point

    def _rates_Hz(self, visit: Visit) -> dict[str, float]:
        """Return how often each checked channel that turns with a visit should bring a value."""
        assert self._tared is not None
        identity = self.bench.identity
        names = [channel.name for channel in identity.channels]
        # Where the device does not state it, a channel comes as often as in the last tare.
        stated_Hz = dict(zip(names, identity.channel_rates_Hz, strict=False))
        rates_Hz = {**self._tared.rates_Hz, **stated_Hz}
        driven = np.flatnonzero(visit.setting.pwm_us > self.motors.stop_us) + 1
        turning = {f"rpm{rotor}" for rotor in driven}
        return {
            name: min(rates_Hz[name], identity.rate_Hz)
            for kind in CHECKS
            for name in names
            if channel_family(name) == kind and (kind != "rpm" or name in turning)
        }

    def _record_plate(self) -> None:
        """Put on the disk what moves the plate, and whether anything measures where it stands."""
        by_hand = self.stage.facts["stage"] == "hand"
        facts = dict(self.stage.facts) | {"measured": self._plate.measured}
        facts |= {"used": self.plan.plate.used, "tolerance_m": self._plate.tolerance_m}
        self.run.update_metadata(plate=facts)
        if remark := facts.get("remark"):
            self.recorder.note("plate", str(remark))
        if facts["stage"] == "none":
            self.recorder.note("plate", "no plate is moved: throttle alone is visited")
        elif not self._plate.measured:
            source = "typed by the operator" if by_hand else "commanded"
            text = f"no channel reads where the plate stands: distances are {source}, not measured"
            self.recorder.note("plate", text)

    def _tare_if_due(self) -> None:
        every_s = 60.0 * self.plan.tare.every_minutes
        if self._tared is not None:
            age_s = self.recorder.now_s - self._tared.time_s
            if not every_s or age_s < every_s:
                return
        self._tared = tare(self.recorder, self.motors, self.plan.tare, self.rig)
        self._tares += 1
        self.recorder.append_point(tare_point(self._tared, self.rig.n_rotors))

    def _go_to(self, place: PlatePosition) -> None:
        if place == self._place:
            return

        def pause(seconds: float) -> None:
            self.recorder.collect("move", seconds)

        self.motors.stand_still(self.plan.tare.stop_timeout_s, "move")
        self._place = None
        try:
            self._reached_m = self.stage.move(place.z_m, place.x_m, radians(place.tilt_deg), pause)
        except PauseRequested:
            self.stage.hold()
            raise
        self.recorder.collect("move", PLATE_SETTLING_S)
        self._place, self._shown = place, {}

    def _settle(self, visit: Visit, watch: VisitWatch) -> bool:
        """Wait until thrust and speeds have settled; record it when they do not in time.

        Ends where the visit is bad.
        """
        plan, recorder = self.plan.settle, self.recorder
        driven = np.flatnonzero(visit.setting.pwm_us > self.motors.stop_us)
        names = ["thrust_N", *(f"rpm{rotor + 1}" for rotor in driven)]
        parts: list[Readings] = []
        begun_s = self.bench.now_s()
        checked_s = begun_s
        while True:
            parts.append(recorder.read("settle", visit.point))
            if watch.take(parts[-1]):
                return False
            now_s = self.bench.now_s()
            if now_s - checked_s >= SETTLE_CHECK_S and now_s - begun_s >= plan.window_s:
                checked_s = now_s
                seen = recorder.joined(parts)
                channels = [seen.column(name) for name in names if name in seen]
                if is_settled(seen.column("time_s"), channels, plan.window_s, plan.slope_per_s):
                    return True
            if now_s - begun_s >= plan.timeout_s:
                text = (
                    f"point {visit.point} had not settled after {plan.timeout_s:g} s and was "
                    f"taken as it was"
                )
                recorder.note("settle_timeout", text, visit.point)
                return False

    def _sampled(self, visit: Visit, watch: VisitWatch) -> Recording:
        """Return the samples of the point; those that came until the visit was found to be bad."""
        parts: list[Readings] = []
        end_s = self.bench.now_s() + self.plan.sample_s
        while watch.problem is None and (left_s := end_s - self.bench.now_s()) > 1e-9:
            parts.append(self.recorder.read("sample", visit.point, min(STEP_S, left_s)))
            watch.take(parts[-1])
        return self.recorder.joined(parts)

    def summarise(self) -> tuple[SweepSummary, str]:
        """Return what was measured, and the text of the run's last event.

        Raises:
            RunInterrupted: visits failed: how many, and how to measure them again.
        """
        if self._failed:
            raise RunInterrupted(
                f"{pluralize(self._failed, 'visit')} failed for samples that were "
                f"too few, late or frozen, {self._measured} are measured; look at the link and the "
                f"sensors (events.jsonl names them), then measure what failed again with benchtool "
                f"sweep --resume"
            )
        quality, seconds = self.recorder.quality, self.recorder.now_s
        summary = SweepSummary(
            self._measured,
            self._unsettled,
            self._suspect,
            self._tares,
            seconds,
            quality.samples,
            quality.lost,
        )
        suspect = f", {self._suspect} of them suspect" if self._suspect else ""
        return summary, f"all is measured: {pluralize(summary.measured, 'visit')}{suspect}"


def _last_values(samples: Recording, names: Iterable[str]) -> dict[str, float]:
    """Return the last number that each channel showed."""
    columns = {name: samples.column(name) for name in names}
    present = {name: column[np.isfinite(column)] for name, column in columns.items()}
    return {name: float(values[-1]) for name, values in present.items() if len(values)}
