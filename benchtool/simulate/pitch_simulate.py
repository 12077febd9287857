"""One run of the pitch bench: with a built-in controller, or with anybody's own class."""

from __future__ import annotations

import traceback
from math import isfinite, isnan
from typing import Any

import numpy as np

from benchtool.control.controller import (
    Controller,
    PitchCommand,
    PitchMeasurement,
    PitchReference,
)
from benchtool.core.schedule import SampledSchedule
from benchtool.errors import InputError
from benchtool.simulate import pitch_rows as r
from benchtool.simulate.pitch_result import PitchRun
from benchtool.simulate.pitch_run import PitchJob, PitchLoop

PitchController = Controller[PitchMeasurement, PitchReference, PitchCommand | float]


def simulate_pitch(
    job: PitchJob, schedule: SampledSchedule, seed: int = 0, run: int = 0
) -> PitchRun:
    """Return one run with a built-in controller.

    Args:
        job: bench and controller.
        schedule: commands at every control tick.
        seed: of the noise.
        run: number of the run under that seed; run 3 of seed 7 is the same in any batch.
    """
    loop = PitchLoop([job], schedule, seed, [run])
    loop.run()
    return taken(loop, 0, job.control.name)


def simulate_controller(
    controller: PitchController,
    job: PitchJob,
    schedule: SampledSchedule,
    seed: int = 0,
    run: int = 0,
    name: str = "own",
) -> PitchRun:
    """Return one run with a controller of the user's own.

    The loop stops at every control tick, hands the readings over, and takes a `PitchCommand` or
    a plain torque in N m. Feedforward and mixer stay the bench's, as `job.control` says.

    Raises:
        InputError: the controller raised, or returned what is no finite number.
    """
    loop = PitchLoop([job], schedule, seed, [run], external=True)
    n = loop.n_discs
    w, dt_s = loop.w, 1.0 / schedule.rate_Hz
    times = schedule.time_s.tolist()
    references = schedule.reference_rad.tolist()
    collectives = (schedule.collective * job.bench.hover_N).tolist()
    step, advance = controller.step, loop.stepper()
    readings = w[r.READ_THETA : r.READ_RANGE + n]
    first_speed, first_range = r.READ_SPEED - r.READ_THETA, r.READ_RANGE - r.READ_THETA
    for tick, time_s in enumerate(times):
        read = readings.tolist()
        measured = PitchMeasurement(
            time_s,
            read[0],
            read[1],
            read[2],
            tuple(read[first_speed : first_speed + n]),
            tuple(read[first_range:]),
        )
        try:
            command = step(measured, PitchReference(references[tick], collectives[tick]), dt_s)
        except Exception as error:
            raise InputError(_raised(controller, error, time_s)) from error
        torque, difference = command if isinstance(command, tuple) else (command, 0.0)
        try:
            usable = isfinite(torque) and isfinite(difference)
        except TypeError:
            usable = False
        if not usable:
            raise InputError(_unusable(controller, torque, difference, time_s))
        w[r.TORQUE] = torque
        w[r.DIFFERENCE] = difference
        advance(tick)
    return taken(loop, 0, name)


def taken(loop: PitchLoop, lane: int, name: str) -> PitchRun:
    """Return one lane of a loop that has run."""
    log = np.ascontiguousarray(loop.log[:, :, lane])
    if not np.isfinite(log).all():
        tick = int(np.argmax(~np.isfinite(log).all(axis=1)))
        raise InputError(
            f"the simulation of {name!r} left the finite numbers at "
            f"{tick / loop.schedule.rate_Hz:g} s; check gains and parameters"
        )
    return PitchRun(
        controller=name,
        rate_Hz=loop.schedule.rate_Hz,
        log=log,
        clamped_steps=int(loop.row(r.CLAMPED)[lane]),
        stopped_steps=int(loop.row(r.STOPPED)[lane]),
    )


def _raised(controller: Any, error: Exception, time_s: float) -> str:
    """Return one sentence that names the user's own line."""
    frames = traceback.extract_tb(error.__traceback__)
    frame = frames[-1]
    for each in frames:
        if each.name == "step":
            frame = each
    said = " ".join(str(error).split()) or "no message"
    return (
        f"controller {type(controller).__name__} raised {type(error).__name__}: {said} at "
        f"{time_s:g} s, in {frame.filename} line {frame.lineno}: {frame.line}; mend that line"
    )


def _unusable(controller: Any, torque: Any, difference: Any, time_s: float) -> str:
    field, value = "torque_Nm", torque
    if isinstance(torque, int | float) and not isnan(torque) and isfinite(torque):
        field, value = "difference_us", difference
    return (
        f"controller {type(controller).__name__} returned {field} = {value!r} at {time_s:g} s; "
        f"return a finite torque in N m, or a PitchCommand"
    )
