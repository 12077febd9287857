"""Run a sweep: visit after visit, every sample on the disk, and a safe end however it ends."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from math import nan, radians

import numpy as np
from numpy.typing import NDArray

from benchtool.acquire.calibration import Calibration
from benchtool.acquire.drift import DriftWatch
from benchtool.acquire.duration import expected_duration_s
from benchtool.acquire.measure import ThrustScale, measure, shortage
from benchtool.acquire.motors import RAMP_DOWN_S, Motors
from benchtool.acquire.order import Place, Visit, visits_of
from benchtool.acquire.plan import Plan
from benchtool.acquire.progress import Progress, SafeProgress, Silent
from benchtool.acquire.record import LinkQuality, Recorder
from benchtool.acquire.rest import rest_if_needed
from benchtool.acquire.settle import is_settled
from benchtool.acquire.tare import Tared, tare, tare_point
from benchtool.bench.bench import Readings
from benchtool.bench.guard import GuardedBench
from benchtool.bench.plate_check import PlateCheck
from benchtool.bench.stage.stage import PlateStage
from benchtool.core.counted import counted
from benchtool.core.errors import InputError, RunStopped, StandstillNotSeen
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.data.run.points import Point
from benchtool.data.run.run import Run

SETTLE_CHECK_S = 0.1
"""How often settling is tested; a choice, a tenth of the usual window."""

TAIL_S = 0.5
"""After an early stop the run records so long how pulses and speeds fall; a choice."""

TRIES = 3
"""A visit of which too few samples come is measured so often; a choice: a link that stumbles fails
one, a bad link all."""

CALM_S = 0.2
"""Time for a plate that has just arrived to come to rest; a choice."""


@dataclass(frozen=True, slots=True)
class Start:
    """Say where a sweep begins: at the start, or behind what a resumed run has on disk.

    Attributes:
        done: numbers of the visits that have their points.
        time_s: time of the run at which this part begins.
        unsettled, tares: how many of the visits that are done, and how many tares.
        link: what was counted so far.
    """

    done: frozenset[int] = frozenset()
    time_s: float = 0.0
    unsettled: int = 0
    tares: int = 0
    link: LinkQuality = field(default_factory=LinkQuality)


@dataclass(frozen=True, slots=True)
class Summary:
    """Say what a sweep did, with all parts of a resumed one."""

    measured: int
    unsettled: int
    tares: int
    duration_s: float
    samples: int
    lost: int


def run_sweep(
    bench: GuardedBench,
    stage: PlateStage,
    plan: Plan,
    rig: Rig,
    run: Run,
    progress: Progress | None = None,
    *,
    calibration: Calibration | None = None,
    start: Start | None = None,
    waits: Callable[[], bool] = lambda: False,
) -> Summary:
    """Run a resolved and checked plan on an open bench.

    Whatever ends it early, zero is commanded first, then the reason is recorded, and it is raised
    again; only a normal end ramps down. The link is closed by who opened it.

    Args:
        bench: open, within its limits.
        stage: moves the plate, open.
        plan: resolved for the rig.
        rig: what stands on the bench.
        run: its folder, created or reopened.
        progress: who watches.
        calibration: applied to raw counts in points.csv; samples.csv keeps what the device said.
        start: where a resumed run goes on.
        waits: asked before every visit; while it says yes, motors stand still and the bench is
            read on.

    Raises:
        StandstillNotSeen: motors may still turn; leaving the guarded bench raises this too.
        BenchError, RunStopped: why it ended early.
    """
    channels = {channel.name for channel in bench.identity.channels}
    if "thrust_N" not in channels:
        raise InputError("the bench streams no thrust_N, so there is nothing to sweep; check it")
    if calibration is not None and "thrust_raw" not in channels:
        raise InputError(
            f"calibration {calibration.id} needs raw counts, but the device streams no thrust_raw; "
            f"sweep with --calibration none"
        )
    sweep = _Sweep(
        bench,
        stage,
        plan,
        rig,
        run,
        SafeProgress(progress or Silent()),
        calibration,
        start or Start(),
        waits,
    )
    return sweep.run_through()


class _Sweep:
    """Hold what one sweep remembers between its visits."""

    def __init__(
        self,
        bench: GuardedBench,
        stage: PlateStage,
        plan: Plan,
        rig: Rig,
        run: Run,
        progress: Progress,
        calibration: Calibration | None,
        start: Start,
        waits: Callable[[], bool],
    ) -> None:
        self._bench, self._stage, self._plan, self._rig = bench, stage, plan, rig
        self._run, self._progress, self._start = run, progress, start
        self._calibration, self._waits = calibration, waits
        self._recorder = Recorder(bench, run, progress, start.time_s, start.link)
        self._motors = Motors(self._recorder, rig)
        self._drift = DriftWatch(plan.tare.drift_N)
        self._place: Place | None = None
        self._reached_m = nan
        self._plate = PlateCheck(bench.identity.channels, rig)
        self._last: Point | None = None
        self._tared: Tared | None = None
        self._measured, self._failed = len(start.done), 0
        self._unsettled, self._tares = start.unsettled, start.tares
        sensor = rig.sensors.get("thrust_N")
        self._quantum_N = sensor.quantum if sensor else 0.0

    def run_through(self) -> Summary:
        recorder = self._recorder
        try:
            try:
                self._visit_all()
                self._motors.ramp_to(self._motors.stop_us, RAMP_DOWN_S, "end")
                self._bench.stop()
                recorder.see_standstill()
                self._bench.require_standstill(ends_normally=True)
                self._require_all()
                summary = self._summary()
                recorder.note("ended", f"all is measured: {counted(summary.measured, 'visit')}")
                recorder.finish("ended")
            except BaseException as error:
                ended_by = self._stop_at_once(error)
                if ended_by is not error:
                    raise ended_by from error
                raise
            return summary
        finally:
            recorder.close()

    def _visit_all(self) -> None:
        visits = visits_of(self._plan, self._rig)
        left = [visit for visit in visits if visit.point not in self._start.done]
        left_s = expected_duration_s(self._plan, self._rig, left)
        self._progress.started(len(visits), len(visits) - len(left), left_s)
        self._say_plate()
        for index, visit in enumerate(left):
            self._wait()
            self._progress.visiting(visit)
            point = self._visit(visit)
            self._recorder.append_point(point)
            self._recorder.sync()
            self._last = point
            if point.kind != "failed":
                self._measured += 1
                self._unsettled += not point.settled
            left_s = expected_duration_s(self._plan, self._rig, left[index + 1 :], self._place)
            self._progress.measured(point, left_s)
            if point.kind == "anchor" and (why := self._drift.asks_for_tare(point)):
                self._recorder.note("drift", why, visit.point)
                self._tared = None

    def _wait(self) -> None:
        if not self._waits():
            return
        self._motors.stand_still(self._plan.tare.stop_timeout_s, "rest")
        self._recorder.note("paused", "paused; motors at zero")
        begun_s = self._recorder.now_s
        while self._waits():
            self._recorder.read("rest")
        self._recorder.note("went_on", f"went on after {self._recorder.now_s - begun_s:.0f} s")

    def _visit(self, visit: Visit) -> Point:
        self._tare_if_due()
        rest_if_needed(self._recorder, self._motors, self._plan.rest, self._last)
        self._go_to(visit.setting.place)
        pulses_us = np.array(visit.setting.pwm_us)
        self._motors.ramp_to(pulses_us, self._plan.throttle.ramp_s, "ramp", visit.point)
        assert self._tared is not None
        for attempt in range(1, TRIES + 1):
            settled = self._settle(visit)
            samples = self._recorder.collect("sample", self._plan.sample_s, visit.point)
            short = shortage(
                samples, self._rates_Hz(visit), self._plan.sample_s, self._plan.sample_share
            )
            if not short:
                break
            then = "measured again" if attempt < TRIES else "marked as failed"
            self._recorder.note("few_samples", f"point {visit.point}: {short}; {then}", visit.point)
        scale = ThrustScale(self._calibration, self._tared.zero_counts, self._quantum_N)
        now_s = self._recorder.now_s
        point = measure(samples, visit, self._reached_m, self._tared, scale, settled, now_s)
        if short:
            self._failed += 1
            return replace(point, kind="failed", settled=False)
        more_m = self._stage.measures_to_m
        if problem := self._plate.crept(self._reached_m, point.plate_read_z_m, more_m):
            raise problem
        return point

    def _rates_Hz(self, visit: Visit) -> dict[str, float]:
        """Return how often each channel that a visit needs should bring a value."""
        assert self._tared is not None
        identity = self._bench.identity
        names = [channel.name for channel in identity.channels]
        # Where the device does not say, thrust comes as often as in the last tare.
        told = dict(zip(names, identity.channel_rates_Hz, strict=False))
        seen_Hz = self._tared.rest_N.n / self._plan.tare.seconds
        rates_Hz = {"thrust_N": told.get("thrust_N", seen_Hz)}
        for rotor, (us, stop_us) in enumerate(
            zip(visit.setting.pwm_us, self._motors.stop_us, strict=True), 1
        ):
            if us > stop_us and f"rpm{rotor}" in told:
                rates_Hz[f"rpm{rotor}"] = told[f"rpm{rotor}"]
        return {name: min(rate_Hz, identity.rate_Hz) for name, rate_Hz in rates_Hz.items()}

    def _say_plate(self) -> None:
        """Put on the disk what moves the plate, and whether anything measures where it stands."""
        by_hand = self._stage.facts["stage"] == "hand"
        facts = dict(self._stage.facts) | {"measured": self._plate.measured}
        self._run.update_metadata(plate=facts | {"tolerance_m": self._plate.tolerance_m})
        if remark := facts.get("remark"):
            self._recorder.note("plate", str(remark))
        if not self._plate.measured:
            source = "typed by the operator" if by_hand else "commanded"
            text = f"no channel reads where the plate stands: distances are {source}, not measured"
            self._recorder.note("plate", text)

    def _tare_if_due(self) -> None:
        every_s = 60.0 * self._plan.tare.every_minutes
        if self._tared is not None:
            age_s = self._recorder.now_s - self._tared.time_s
            if not every_s or age_s < every_s:
                return
        self._tared = tare(self._recorder, self._motors, self._plan.tare, self._rig)
        self._tares += 1
        self._recorder.append_point(tare_point(self._tared, self._rig.n_rotors))

    def _go_to(self, place: Place) -> None:
        if place == self._place:
            return
        self._motors.stand_still(self._plan.tare.stop_timeout_s, "move")
        self._reached_m = self._stage.move(
            place.z_m, place.x_m, radians(place.tilt_deg), self._pause
        )
        self._recorder.collect("move", CALM_S)
        self._place = place

    def _pause(self, seconds: float) -> None:
        self._recorder.collect("move", seconds)

    def _settle(self, visit: Visit) -> bool:
        """Wait until thrust and speeds have settled; say so when they do not in time."""
        plan, recorder = self._plan.settle, self._recorder
        rotors = [
            r + 1 for r, us in enumerate(visit.setting.pwm_us) if us > self._motors.stop_us[r]
        ]
        parts: list[Readings] = []
        begun_s = self._bench.now_s()
        checked_s = begun_s
        while True:
            parts.append(recorder.read("settle", visit.point))
            now_s = self._bench.now_s()
            if now_s - checked_s >= SETTLE_CHECK_S and now_s - begun_s >= plan.window_s:
                checked_s = now_s
                seen = recorder.joined(parts)
                if is_settled(
                    seen.column("time_s"),
                    _watched(seen, rotors),
                    plan.window_s,
                    plan.slope_per_s,
                ):
                    return True
            if now_s - begun_s >= plan.timeout_s:
                text = (
                    f"point {visit.point} had not settled after {plan.timeout_s:g} s and was "
                    f"taken as it was"
                )
                recorder.note("settle_timeout", text, visit.point)
                return False

    def _stop_at_once(self, error: BaseException) -> BaseException:
        """Command zero before anything else and return the error that ends the run.

        Nothing that fails on the way hides that error.
        """
        with suppress(Exception):
            self._bench.stop()
        with suppress(Exception):
            self._stage.hold()
        interrupted = isinstance(error, KeyboardInterrupt)
        reason = "stopped by Ctrl-C" if interrupted else str(error) or type(error).__name__
        with suppress(Exception):
            if kept := self._bench.take_unread():
                self._recorder.keep(kept, "end")
        with suppress(Exception):
            # How the rotors slow down, and what waited in the link.
            if not isinstance(error, StandstillNotSeen):
                self._recorder.see_standstill(TAIL_S)
        if not isinstance(error, StandstillNotSeen):
            reason = self._bench.with_standstill(reason)
        with suppress(Exception):
            self._recorder.finish("stopped", reason)
        with suppress(Exception):
            self._recorder.note("stopped", reason)
        return self._recorder.rescue(error)

    def _require_all(self) -> None:
        """Refuse to call a run ended of which visits failed.

        Raises:
            RunStopped: how many, and how to measure them again.
        """
        if self._failed:
            raise RunStopped(
                f"{counted(self._failed, 'visit')} failed for want of samples, "
                f"{self._measured} are measured; look at the link, then measure what failed again "
                f"with benchtool sweep --resume"
            )

    def _summary(self) -> Summary:
        quality = self._recorder.quality
        return Summary(
            self._measured,
            self._unsettled,
            self._tares,
            self._recorder.now_s,
            quality.samples,
            quality.lost,
        )


def _watched(seen: Recording, rotors: Sequence[int]) -> list[NDArray[np.float64]]:
    names = ["thrust_N", *(f"rpm{rotor}" for rotor in rotors)]
    return [seen.column(name) for name in names if name in seen]
