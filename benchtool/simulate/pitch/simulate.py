"""Single run of the pitch bench, with a built-in or a user-defined controller."""

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
    loop = PitchLoop([job], schedule, seed, [0], external=True)
    user_controller_ticks(loop)(controller, 0, len(schedule), 0)
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


PitchController = Controller[PitchMeasurement, PitchReference, PitchCommand | float]

COMMAND_REMEDY = "a finite torque in N m, or a PitchCommand of finite numbers"


def user_controller_ticks(loop: PitchLoop) -> Callable[[PitchController, int, int, int], None]:
    """Return a function that runs control ticks of a loop with a user-defined controller.

    Arguments: controller, first tick, end (exclusive), and number of ticks of the controller's run
    before the first. It raises InputError if the controller raises or returns numbers that are not
    finite. The driver of the loop must be `CALLER`.
    """
    advance = loop.stepper()
    rate_Hz, dt_s = loop.schedule.rate_Hz, 1.0 / loop.schedule.rate_Hz
    readings_view, command_view = loop.view("readings")[:, 0], loop.view("command")[:, 0]
    new = tuple.__new__  # faster than the constructors of the named tuples by 0.5 us a tick

    def run(controller: PitchController, first: int, last: int, before: int) -> None:
        step = controller.step
        references = zip(
            *(
                loop.schedule_view(field)[0, first:last].tolist()
                for field in ("setpoint.reference_rad", "setpoint.collective_N", "observer")
            ),
            strict=True,
        )
        for number, reference in enumerate(references):
            time_s = (before + number) / rate_Hz
            numbers = readings_view.tolist()
            measured = new(
                PitchMeasurement, (time_s, numbers[0], numbers[1], numbers[2], tuple(numbers[3:]))
            )
            try:
                command = step(measured, new(PitchReference, reference), dt_s)
            except (Exception, SystemExit) as error:
                raise controller_error(controller, error, time_s) from error
            try:
                torque, difference = command if isinstance(command, tuple) else (command, 0.0)
                is_valid = isfinite(torque) and isfinite(difference)
            except (TypeError, ValueError):
                is_valid = False
            if not is_valid:
                raise _invalid_field_error(controller, command, time_s)
            command_view[:2] = torque, difference
            advance(first + number, first + number + 1)

    return run


def _invalid_field_error(controller: Any, command: Any, time_s: float) -> InputError:
    """Return an error about the first invalid field of a command."""
    if not isinstance(command, tuple):
        return invalid_command_error(controller, "torque_Nm", command, time_s, COMMAND_REMEDY)
    if len(command) != len(PitchCommand._fields):
        return invalid_command_error(controller, "a command", command, time_s, COMMAND_REMEDY)
    is_torque_valid = isinstance(command[0], int | float) and isfinite(command[0])
    return invalid_command_error(
        controller,
        PitchCommand._fields[is_torque_valid],
        command[is_torque_valid],
        time_s,
        COMMAND_REMEDY,
    )
