"""Runs of the pitch bench, single, with a user-defined controller, or as a batch; their measures.

A batch runs in parallel lanes and threads. Every run has its own number and noise stream: its
result does not depend on other runs, on the number of lanes or of threads. Blocks are yielded one
by one, so that memory does not grow with the number of runs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import TypeVar

import numpy as np

from benchtool.core.channel import Channel, unit_from_name
from benchtool.core.errors import InputError
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.core.schedule import PARKED_M, PlateVisit, SampledSchedule
from benchtool.core.units import Array
from benchtool.physics.expression import can_compile
from benchtool.simulate.controllers.controller import (
    Controller,
    PitchCommand,
    PitchMeasurement,
    PitchReference,
)
from benchtool.simulate.loop import CALLER, results_in_order
from benchtool.simulate.pitch.loops import COLUMNS
from benchtool.simulate.pitch.run import PitchJob, PitchLoop

PitchController = Controller[PitchMeasurement, PitchReference, PitchCommand | float]

T = TypeVar("T")

# Enough lanes for vectorisation, few enough for the processor cache. Measured: 16, 24, 32 and 64
# lanes take 306, 242, 241 and 246 us for a run of 10 s.
LANES = 32


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PitchRun:
    """Simulated run.

    Attributes:
        rate_Hz: control rate; one row per control tick.
        log: (n_ticks, 10 + 2 n_discs): `COLUMNS`, pulses, measured rotor speeds (rad/s).
        clamped_steps: plant steps with a disc below the validity limit of the formulae.
        stopped_steps: plant steps at the end stop.
    """

    controller: str
    rate_Hz: float
    log: Array
    clamped_steps: int = 0
    stopped_steps: int = 0

    @property
    def time_s(self) -> Array:
        """Time since the start of the run (n_ticks,)."""
        return np.arange(len(self.log)) / self.rate_Hz

    @property
    def n_discs(self) -> int:
        """Number of discs."""
        return int(self.log.shape[1] - len(COLUMNS)) // 2

    def column(self, name: str) -> Array:
        """Return one of `COLUMNS` (n_ticks,)."""
        return self.log[:, [*COLUMNS].index(name)]

    @property
    def pwm_us(self) -> Array:
        """Pulse width of each disc (n_discs, n_ticks)."""
        return self.log[:, len(COLUMNS) : len(COLUMNS) + self.n_discs].T

    @property
    def speed_rad_s(self) -> Array:
        """Measured rotor speed of each disc (n_discs, n_ticks)."""
        return self.log[:, len(COLUMNS) + self.n_discs :].T

    def recording(self, rig: Rig, provenance: Mapping[str, str] | None = None) -> Recording:
        """Return the run as the recording that a pitch bench would have written."""
        share, rotor_discs = self.column("plate_share"), list(enumerate(rig.disc_of_rotor, 1))
        pwm, rpm = self.pwm_us, self.speed_rad_s * 30.0 / np.pi
        columns = {
            "time_s": self.time_s,
            "theta_ref_rad": self.column("reference_rad"),
            "theta_rad": self.column("theta_rad"),
            "gyro_rad_s": self.column("gyro_rad_s"),
            **{f"pwm{i}_us": pwm[disc] for i, disc in rotor_discs},
            **{f"rpm{i}": rpm[disc] for i, disc in rotor_discs},
            "plate_z_m": np.where(share > 0.0, self.column("plate_read_m"), PARKED_M),
            "coverage1": share,
            "torque_Nm": self.column("torque_Nm"),
            "disturbance_Nm": self.column("estimate_Nm"),
        }
        channels = (Channel(name, unit_from_name(name)) for name in columns)
        pairs = list(zip(channels, columns.values(), strict=True))
        return Recording.from_columns(pairs, provenance, simulated=True)


def simulate_pitch(
    job: PitchJob,
    schedule: SampledSchedule,
    seed: int = 0,
    run: int = 0,
    *,
    neutral_too: bool = False,
) -> PitchRun:
    """Return one run with a built-in controller; run 3 of seed 7 is the same in any batch.

    With `neutral_too` one compilation serves all parameter values, see `loop_effects`.
    """
    loop = PitchLoop([job], schedule, seed, [run], neutral_too=neutral_too)
    loop.run()
    return extract_run(loop, 0, job.control.name)


def simulate_controller(
    controller: PitchController,
    job: PitchJob,
    schedule: SampledSchedule,
    seed: int = 0,
    name: str = "own",
) -> PitchRun:
    """Return one run with a user-defined controller.

    At every control tick it gets the readings and returns a `PitchCommand` or a torque in N m.
    Feedforward and mixer are those of `job.control`.

    Raises:
        InputError: the controller raised, or returned numbers that are not finite.
    """
    loop = PitchLoop([job], schedule, seed, [0])
    loop.set_driver(CALLER)
    loop.run_controller(controller, 0, len(schedule))
    return extract_run(loop, 0, name)


def extract_run(loop: PitchLoop, lane: int, name: str) -> PitchRun:
    """Return the run of one lane of a finished loop."""
    log = np.ascontiguousarray(loop.log[:, :, lane])
    if not np.isfinite(log).all():
        tick = int(np.argmax(~np.isfinite(log).all(axis=1)))
        raise InputError(
            f"the simulation of {name!r} is not finite from "
            f"{tick / loop.schedule.rate_Hz:g} s; check gains and parameters"
        )
    return PitchRun(
        controller=name,
        rate_Hz=loop.schedule.rate_Hz,
        log=log,
        clamped_steps=int(loop.view("hinge.clamped_steps")[0, lane]),
        stopped_steps=int(loop.view("hinge.stopped_steps")[0, lane]),
    )


def simulate_many(
    jobs: Iterable[tuple[PitchJob, int]],
    schedule: SampledSchedule,
    take: Callable[[PitchLoop, int, int], T],
    *,
    seed: int = 0,
    threads: int | None = None,
    lanes: int | None = None,
) -> Iterator[T]:
    """Yield the result `take(loop, lane, run)` of every run, in order.

    Args:
        jobs: jobs with their run numbers; all share rig, wake rule and sensor rates.
        take: called in the thread of the run. The log is overwritten afterwards and must be copied.
        threads: number of parallel threads; None means all cores.
        lanes: runs per loop; None means `LANES`, or 1 without a compiler.
    """
    width = lanes if lanes is not None else (LANES if can_compile() else 1)
    remaining = iter(jobs)
    free_logs: list[Array] = []  # reused, because new memory is slow

    def run_block(block: list[tuple[PitchJob, int]]) -> list[T]:
        lane_jobs, runs = zip(*block, *[block[-1]] * (width - len(block)), strict=True)
        log = free_logs.pop() if free_logs else None
        loop = PitchLoop(lane_jobs, schedule, seed, runs, log=log)
        loop.run()
        block_results = [take(loop, lane, runs[lane]) for lane in range(len(block))]
        free_logs.append(loop.log)
        return block_results

    blocks = iter(lambda: list(islice(remaining, width)), [])
    for results in results_in_order((partial(run_block, block) for block in blocks), threads):
        yield from results


@dataclass(frozen=True, slots=True)
class PlateVisitMeasures:
    """Measures of the true attitude error of a plate visit.

    Attributes:
        quiet_rms_rad: before the visit.
        peak_rad: largest error during the visit, with its sign.
        settling_s: time until the error stays within 20 % of the peak about its residual; nan if
            the peak is not above the noise before the visit.
        residual_rad: mean error over the last quarter of the visit.
        rebound_rad: largest error of the opposite sign after the visit, else 0.
    """

    quiet_rms_rad: float
    peak_rad: float
    settling_s: float
    residual_rad: float
    rebound_rad: float


SETTLING_BAND = 0.2  # share of the peak
MIN_PEAK_OVER_RMS = 5.0  # smaller peaks are noise; assumed


def measure_plate_visit(run: PitchRun, visit: PlateVisit, duration_s: float) -> PlateVisitMeasures:
    """Return the measures of a plate visit in a run of that duration."""
    time_s, in_s, out_s = run.time_s, visit.in_s, min(visit.out_s, duration_s)
    error = run.column("true_theta_rad") - run.column("reference_rad")
    before = (time_s < in_s) & (time_s >= 0.4 * in_s)
    during = (time_s >= in_s) & (time_s < out_s)
    last_quarter = (time_s >= in_s + 0.75 * (out_s - in_s)) & (time_s < out_s)
    after = time_s >= out_s
    quiet_rms = float(np.sqrt(np.mean(error[before] ** 2))) if before.any() else float("nan")
    if not during.any():
        nan = float("nan")
        return PlateVisitMeasures(quiet_rms, nan, nan, nan, nan)
    visit_error, times = error[during], time_s[during] - in_s
    peak = float(visit_error[np.argmax(np.abs(visit_error))])
    residual = float(np.mean(error[last_quarter]))
    outside = np.abs(visit_error - residual) > SETTLING_BAND * abs(peak)
    settling_s = float(times[np.flatnonzero(outside)[-1]]) if outside.any() else 0.0
    if abs(peak) < MIN_PEAK_OVER_RMS * quiet_rms:
        settling_s = float("nan")
    opposite_error = error[after] * -np.sign(peak) if after.any() else np.zeros(1)
    rebound = float(max(opposite_error.max(), 0.0)) * -float(np.sign(peak))
    return PlateVisitMeasures(quiet_rms, peak, settling_s, residual, rebound)
