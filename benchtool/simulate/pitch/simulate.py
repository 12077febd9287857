"""One run of the pitch bench: with a built-in controller, or with anybody's own class."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from typing import Any

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.schedule import SampledSchedule
from benchtool.simulate.controllers.controller import (
    Controller,
    PitchCommand,
    PitchMeasurement,
    PitchReference,
)
from benchtool.simulate.pitch.result import PitchRun
from benchtool.simulate.pitch.run import PitchJob, PitchLoop
from benchtool.simulate.user_controller import controller_error, invalid_command_error


def simulate_pitch(
    job: PitchJob, schedule: SampledSchedule, seed: int = 0, run: int = 0
) -> PitchRun:
    """Return one run with a built-in controller.

    Args:
        run: number of the run under that seed; run 3 of seed 7 is the same in any batch.
    """
    loop = PitchLoop([job], schedule, seed, [run])
    loop.run()
    return parse_command(loop, 0, job.control.name)


def simulate_controller(
    controller: PitchController,
    job: PitchJob,
    schedule: SampledSchedule,
    seed: int = 0,
    name: str = "own",
) -> PitchRun:
    """Return one run with a controller of the user's own.

    The loop stops at every control tick, hands the readings over, and takes a `PitchCommand` or
    a plain torque in N m. Feedforward and mixer stay the bench's, as `job.control` says.

    Raises:
        InputError: the controller raised, or returned what is no finite number.
    """
    loop = PitchLoop([job], schedule, seed, [0], external=True)
    user_controller_ticks(loop)(controller, 0, len(schedule), 0)
    return parse_command(loop, 0, name)


def parse_command(loop: PitchLoop, lane: int, name: str) -> PitchRun:
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
        clamped_steps=int(loop.view("hinge.clamped_steps")[0, lane]),
        stopped_steps=int(loop.view("hinge.stopped_steps")[0, lane]),
    )


PitchController = Controller[PitchMeasurement, PitchReference, PitchCommand | float]

WANTED = "a finite torque in N m, or a PitchCommand of finite numbers"


def user_controller_ticks(loop: PitchLoop) -> Callable[[PitchController, int, int, int], None]:
    """Return a function that runs control ticks of a loop under anybody's controller.

    Its arguments: the controller, the first tick, the tick to stop before, and how many ticks
    of the controller's run lie before the first. It raises InputError where the controller raised,
    or returned what is no finite number. The loop's driver must be the caller.
    """
    advance = loop.stepper()
    rate_Hz, dt_s = loop.schedule.rate_Hz, 1.0 / loop.schedule.rate_Hz
    readings, sent = loop.view("readings")[:, 0], loop.view("command")[:, 0]
    new = tuple.__new__  # spares the named tuples' own constructors, half a microsecond a tick

    def run(controller: PitchController, first: int, last: int, before: int) -> None:
        step = controller.step
        references = zip(
            *(
                loop.planned(field)[0, first:last].tolist()
                for field in ("setpoint.reference_rad", "setpoint.collective_N", "observer")
            ),
            strict=True,
        )
        for number, planned in enumerate(references):
            time_s = (before + number) / rate_Hz
            read = readings.tolist()
            measured = new(PitchMeasurement, (time_s, read[0], read[1], read[2], tuple(read[3:])))
            try:
                command = step(measured, new(PitchReference, planned), dt_s)
            except (Exception, SystemExit) as error:
                raise controller_error(controller, error, time_s) from error
            try:
                torque, difference = command if isinstance(command, tuple) else (command, 0.0)
                usable = isfinite(torque) and isfinite(difference)
            except (TypeError, ValueError):
                usable = False
            if not usable:
                raise _faulty(controller, command, time_s)
            sent[:2] = torque, difference
            advance(first + number, first + number + 1)

    return run


def _faulty(controller: Any, command: Any, time_s: float) -> InputError:
    """Return what is wrong with a command, by its field."""
    if not isinstance(command, tuple):
        return invalid_command_error(controller, "torque_Nm", command, time_s, WANTED)
    if len(command) != len(PitchCommand._fields):
        return invalid_command_error(controller, "a command", command, time_s, WANTED)
    fine = isinstance(command[0], int | float) and isfinite(command[0])
    return invalid_command_error(
        controller, PitchCommand._fields[fine], command[fine], time_s, WANTED
    )
