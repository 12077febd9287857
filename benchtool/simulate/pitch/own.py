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
from benchtool.simulate.pitch import rows as r
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
    n, rate_Hz = loop.n_discs, loop.schedule.rate_Hz
    w, dt_s = loop.w, 1.0 / rate_Hz
    speed = r.READ_SPEED - r.READ_THETA
    readings = w[r.READ_THETA : r.READ_SPEED + n]
    new = tuple.__new__  # spares the named tuples' own constructors, half a microsecond a tick

    def run(controller: PitchController, first: int, last: int, before: int) -> None:
        step = controller.step
        references = loop.table[r.S_REFERENCE, first:last].tolist()
        collectives = loop.table[r.S_COLLECTIVE, first:last].tolist()
        for number in range(last - first):
            time_s = (before + number) / rate_Hz
            read = readings.tolist()
            measured = new(
                PitchMeasurement,
                (time_s, read[0], read[1], read[2], tuple(read[speed:])),
            )
            reference = new(PitchReference, (references[number], collectives[number]))
            try:
                command = step(measured, reference, dt_s)
            except (Exception, SystemExit) as error:
                raise raised(controller, error, time_s) from error
            try:
                torque, difference = command if isinstance(command, tuple) else (command, 0.0)
                usable = isfinite(torque) and isfinite(difference)
            except (TypeError, ValueError):
                usable = False
            if not usable:
                raise _faulty(controller, command, time_s)
            w[r.TORQUE] = torque
            w[r.DIFFERENCE] = difference
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
