"""Recording of a pitch experiment with the control loop on the device."""

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
from benchtool.core.rig import Rig
from benchtool.core.text import pluralize
from benchtool.data.run.run import Run

RAMP_UP_S = 0.5  # ramp from idle to the collective; ten times the motor lag; assumed
CHUNK_S = 1.0  # interval of statistics and of syncing to disk; assumed


@dataclass(slots=True)
class PitchSummary:
    """Summary of a pitch recording; angles in rad, nan without reference."""

    seconds: float = 0.0
    samples: int = 0
    lost: int = 0
    max_angle_rad: float = 0.0
    rms_error_rad: float = float("nan")


class PitchRecorder(Recorder):
    """Recorder that stops at excessive pitch angle or rate."""

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

    def stop_watching(self) -> None:
        """Stop checking limits; only record from now on."""
        self._watched = []

    def store(self, readings: Readings, phase: str, point: int = 0) -> Readings:
        """Write readings; if they exceed a limit, command zero first (once).

        Raises:
            LimitExceeded: after the samples were stored on disk or for `rescue`.
        """
        for index, name in self._watched:
            limit, column = self._limits[name], readings.values[:, index]
            beyond = column[np.abs(column) > limit]
            if len(beyond):
                self.stop_watching()
                with suppress(Exception):
                    self.bench.stop()
                with suppress(Exception):
                    super().store(readings, phase, point)
                remedy = "check gains and mechanics, or raise --limit-deg"
                raise LimitExceeded(name, float(beyond[0]), limit, remedy)
        return super().store(readings, phase, point)


def record_pitch(
    bench: GuardedBench,
    rig: Rig,
    experiment: PitchExperiment,
    run: Run,
    progress: RunProgress | None = None,
    report_remaining: Callable[[float], None] = lambda remaining_s: None,
) -> PitchSummary:
    """Record a checked experiment on an open bench, and end it with `run_to_end`.

    Args:
        report_remaining: called with the remaining seconds, about every second.

    Raises:
        StandstillNotConfirmed: motors may still turn; closing the guarded bench raises it too.
        BenchError, RunInterrupted: reason of an early end.
    """
    require_pitch(bench.identity)
    bench.expect_loop()
    recorder = PitchRecorder(bench, run, SafeProgress(progress), experiment.pitch_limit_rad)
    motors, summary = Motors(recorder, rig), PitchSummary(experiment.seconds)

    def measure() -> None:
        if experiment.plate_z_m is not None:
            bench.move_plate(experiment.plate_z_m)
        recorder.record_event("armed", f"collective {experiment.collective_us:g} us")
        motors.ramp_to(np.full(rig.n_rotors, experiment.collective_us), RAMP_UP_S, "ramp")
        _collect(recorder, summary, report_remaining)

    def summarise() -> tuple[PitchSummary, str]:
        # All samples on disk, including the ramps.
        summary.samples, summary.lost = recorder.quality.samples, recorder.quality.lost
        return summary, f"{summary.seconds:g} s recorded"

    return run_to_end(recorder, motors, measure, summarise, recorder.stop_watching)


def _collect(
    recorder: PitchRecorder, summary: PitchSummary, report_remaining: Callable[[float], None]
) -> None:
    """Record the seconds of a summary and fill in its angles."""
    squares, count = 0.0, 0
    end_s = recorder.bench.now_s() + summary.seconds
    while (remaining_s := end_s - recorder.bench.now_s()) > 1e-9:
        report_remaining(remaining_s)
        part = recorder.collect("sample", min(CHUNK_S, remaining_s))
        recorder.sync()
        theta = part.column("theta_rad")
        summary.max_angle_rad = max(
            summary.max_angle_rad, float(np.nanmax(np.abs(theta), initial=0.0))
        )
        if "theta_ref_rad" in part:
            error = theta - part.column("theta_ref_rad")
            squares += float(np.nansum(error**2))
            count += int(np.isfinite(error).sum())
    if count:
        summary.rms_error_rad = float(np.sqrt(squares / count))


def summary_line(summary: PitchSummary) -> str:
    """Return the summary as one line."""
    error = summary.rms_error_rad
    tracking = "" if np.isnan(error) else f", RMS error {degrees(error):.2f} deg"
    return (
        f"{summary.seconds:g} s, {pluralize(summary.samples, 'sample')}, {summary.lost} lost; "
        f"largest angle {degrees(summary.max_angle_rad):.2f} deg{tracking}"
    )
