"""A pitch controller of the user's own in the loop, which stops for it at every control tick."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from typing import Any

from benchtool.core.errors import InputError
from benchtool.simulate.controllers.controller import (
    Controller,
    PitchCommand,
    PitchMeasurement,
    PitchReference,
)
from benchtool.simulate.own_controller import raised, unusable
from benchtool.simulate.pitch.run import PitchLoop

PitchController = Controller[PitchMeasurement, PitchReference, PitchCommand | float]

WANTED = "a finite torque in N m, or a PitchCommand of finite numbers"


def own_ticks(loop: PitchLoop) -> Callable[[PitchController, int, int, int], None]:
    """Return a function that runs control ticks of a loop under anybody's controller.

    Its arguments: the controller, the first tick, the tick to stop before, and how many ticks
    of the controller's run lie before the first. It raises InputError where the controller raised,
    or returned what is no finite number. The loop's plan must say that the caller controls.
    """
    advance = loop.stepper()
    rate_Hz, dt_s = loop.schedule.rate_Hz, 1.0 / loop.schedule.rate_Hz
    readings, sent = loop.view("readings")[:, 0], loop.view("command")[:, 0]
    new = tuple.__new__  # spares the named tuples' own constructors, half a microsecond a tick

    def run(controller: PitchController, first: int, last: int, before: int) -> None:
        step = controller.step
        wishes = zip(
            *(
                loop.wish(field)[0, first:last].tolist()
                for field in ("setpoint.reference_rad", "setpoint.collective_N", "observer")
            ),
            strict=True,
        )
        for number, wish in enumerate(wishes):
            time_s = (before + number) / rate_Hz
            read = readings.tolist()
            measured = new(
                PitchMeasurement,
                (time_s, read[0], read[1], read[2], tuple(read[3:])),
            )
            try:
                command = step(measured, new(PitchReference, wish), dt_s)
            except (Exception, SystemExit) as error:
                raise raised(controller, error, time_s) from error
            try:
                torque, difference = command if isinstance(command, tuple) else (command, 0.0)
                usable = isfinite(torque) and isfinite(difference)
            except (TypeError, ValueError):
                usable = False
            if not usable:
                raise _faulty(controller, command, time_s)
            sent[:2] = torque, difference
            advance(first + number)

    return run


def _faulty(controller: Any, command: Any, time_s: float) -> InputError:
    """Return what is wrong with a command, by its field."""
    if not isinstance(command, tuple):
        return unusable(controller, "torque_Nm", command, time_s, WANTED)
    if len(command) != len(PitchCommand._fields):
        return unusable(controller, "a command", command, time_s, WANTED)
    fine = isinstance(command[0], int | float) and isfinite(command[0])
    return unusable(controller, PitchCommand._fields[fine], command[fine], time_s, WANTED)
