"""Record a pitch experiment: arm the device's loop, log every sample, and end safely."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from math import degrees

import numpy as np

from benchtool.acquire.motors import Motors, run_to_end
from benchtool.acquire.pitch_experiment import RATE_LIMIT_RAD_S, PitchExperiment, require_pitch
from benchtool.acquire.record import Recorder, RunProgress, SafeProgress
from benchtool.bench.bench import Readings
from benchtool.bench.guard import GuardedBench
from benchtool.core.errors import LimitExceeded
from benchtool.core.plural import pluralize
from benchtool.core.rig import Rig
from benchtool.data.run.run import Run

RAMP_UP_S = 0.5  # from idle to the collective in so long; assumed, ten times the lag of a motor
CHUNK_S = 1.0  # samples are summed up and forced to the disk so often; assumed


@dataclass(slots=True)
class PitchSummary:
    """Say what was recorded; angles in rad, nan where the device gave no reference."""

    seconds: float = 0.0
    samples: int = 0
    lost: int = 0
    largest_rad: float = 0.0
    rms_error_rad: float = float("nan")


class PitchRecorder(Recorder):
    """Record, and stop when the beam turns too far or too fast."""

    def __init__(
        self, bench: GuardedBench, run: Run, progress: RunProgress, pitch_limit_rad: float
    ) -> None:
        super().__init__(bench, run, progress)
        self._limits = {"theta_rad": pitch_limit_rad, "gyro_rad_s": RATE_LIMIT_RAD_S}
        self._watched = [
            (index, channel.name)
            for index, channel in enumerate(bench.identity.channels)
            if channel.name in self._limits
        ]

    def watch_no_more(self) -> None:
        """Only record from now on: there is nothing left to stop."""
        self._watched = []

    def store(self, readings: Readings, phase: str, point: int = 0) -> Readings:
        """Write readings; command zero before that where they lie beyond a limit, once.

        Raises:
            LimitExceeded: the samples that show it are on the disk, or wait for `rescue`.
        """
        for index, name in self._watched:
            limit, column = self._limits[name], readings.values[:, index]
            beyond = column[np.abs(column) > limit]
            if len(beyond):
                self.watch_no_more()
                with suppress(Exception):
                    self.bench.stop()
                with suppress(Exception):
                    super().store(readings, phase, point)
                remedy = "look at gains and mechanics, or raise --limit-deg"
                raise LimitExceeded(name, float(beyond[0]), limit, remedy)
        return super().store(readings, phase, point)


def record_pitch(
    bench: GuardedBench,
    rig: Rig,
    experiment: PitchExperiment,
    run: Run,
    progress: RunProgress | None = None,
    left: Callable[[float], None] = lambda left_s: None,
) -> PitchSummary:
    """Record a checked experiment on an open bench, and end it as `run_to_end` says.

    Args:
        left: called with the seconds that are left, about every second.

    Raises:
        StandstillNotSeen: motors may still turn; leaving the guarded bench raises this too.
        BenchError, RunStopped: why it ended early.
    """
    require_pitch(bench.identity)
    bench.expect_loop()
    recorder = PitchRecorder(bench, run, SafeProgress(progress), experiment.pitch_limit_rad)
    motors, summary = Motors(recorder, rig), PitchSummary(experiment.seconds)

    def measure() -> None:
        if experiment.plate_z_m is not None:
            bench.move_plate(experiment.plate_z_m)
        recorder.note("armed", f"collective {experiment.collective_us:g} us")
        motors.ramp_to(np.full(rig.n_rotors, experiment.collective_us), RAMP_UP_S, "ramp")
        _collect(recorder, summary, left)

    def summarise() -> tuple[PitchSummary, str]:
        # All that is on the disk, the ramps too.
        summary.samples, summary.lost = recorder.quality.samples, recorder.quality.lost
        return summary, f"{summary.seconds:g} s are recorded"

    return run_to_end(recorder, motors, measure, summarise, recorder.watch_no_more)


def _collect(recorder: PitchRecorder, summary: PitchSummary, left: Callable[[float], None]) -> None:
    """Record the seconds of a summary and fill in its angles."""
    squares, count = 0.0, 0
    begun_s = recorder.bench.now_s()
    while (left_s := begun_s + summary.seconds - recorder.bench.now_s()) > 1e-9:
        left(left_s)
        part = recorder.collect("sample", min(CHUNK_S, left_s))
        recorder.sync()
        theta = part.column("theta_rad")
        summary.largest_rad = max(summary.largest_rad, float(np.nanmax(np.abs(theta), initial=0.0)))
        if "theta_ref_rad" in part:
            error = theta - part.column("theta_ref_rad")
            squares += float(np.nansum(error**2))
            count += int(np.isfinite(error).sum())
    if count:
        summary.rms_error_rad = float(np.sqrt(squares / count))


def summary_line(summary: PitchSummary) -> str:
    """Return a recording in one line."""
    error = summary.rms_error_rad
    tracking = "" if np.isnan(error) else f", RMS error {degrees(error):.2f} deg"
    return (
        f"{summary.seconds:g} s, {pluralize(summary.samples, 'sample')}, {summary.lost} lost; "
        f"largest angle {degrees(summary.largest_rad):.2f} deg{tracking}"
    )
