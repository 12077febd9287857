"""A flight under a controller of the user's own: the same loop, stopped at every period."""

from __future__ import annotations

from math import inf, isfinite
from typing import Any

import numpy as np

from benchtool.core.errors import InputError
from benchtool.simulate.controllers.controller import (
    FlightCommand,
    FlightController,
    FlightMeasurement,
    FlightReference,
)
from benchtool.simulate.flight.flight import Flight, FlightCase, FlightLoop
from benchtool.simulate.flight.records import tick_rows
from benchtool.simulate.layout import lend_rows
from benchtool.simulate.user_controller import controller_error, invalid_command_error

WANTED = "a FlightCommand(thrust_N, roll_Nm, pitch_Nm, yaw_Nm) of finite numbers"


def fly_user_controller(case: FlightCase, controller: FlightController, name: str) -> Flight:
    """Fly a case with a controller of the user's own.

    The map that it sees is the case's, with its errors; gains and control of the case do not act,
    but for the gains' control rate.

    Raises:
        InputError: as `fly`; or the controller raised, or returned what is no command.
    """
    loop = FlightLoop(case, external=True)
    run, plan, n_discs = loop.loops.run, loop.plan, case.vehicle.rig.n_discs
    arrays = lend_rows(run, loop.arrays)
    n_scalars, rate_Hz = len(FlightMeasurement._fields) - 2, case.gains.control_rate_Hz
    seen, command = loop.view("measured"), loop.view("command")
    wrench, factors = command[:4], command[4:]
    wanted = loop.arrays.schedule[tick_rows("reference")].T.tolist()
    step, new = controller.step, tuple.__new__  # spares the named tuples' own constructors
    run(arrays, plan, -1, 0)
    for period in range(loop.n_ticks):
        time_s = period / rate_Hz
        read = seen.tolist()
        over, covered = tuple(read[n_scalars:-n_discs]), tuple(read[-n_discs:])
        measured = new(FlightMeasurement, (time_s, *read[1:n_scalars], over, covered))
        try:
            given = step(measured, new(FlightReference, wanted[period]), 1.0 / rate_Hz)
        except (Exception, SystemExit) as error:
            raise controller_error(controller, error, time_s) from error
        factors[:] = 1.0
        try:
            thrust, roll, pitch, yaw, *rest = given
            wrench[0], wrench[1], wrench[2], wrench[3] = thrust, roll, pitch, yaw
            usable = isfinite(thrust + roll + pitch + yaw)
            if rest and rest != [()]:
                (divide_by,) = rest
                factors[:] = divide_by
                usable = usable and len(divide_by) == n_discs
                usable = usable and all(0.0 < factor < inf for factor in divide_by)
        except (TypeError, ValueError):
            usable = False
        if not usable:
            raise _faulty(controller, given, time_s, n_discs)
        loop.ended = run(arrays, plan, period, period + 1)
        if loop.ended == period:
            break
    return loop.flight(name)


def _faulty(controller: Any, command: Any, time_s: float, n_discs: int) -> InputError:
    """Return what is wrong with a command, by its field."""
    if not isinstance(command, tuple | list) or not 4 <= len(command) <= 5:
        return invalid_command_error(controller, "a command", command, time_s, WANTED)
    for field, value in zip(FlightCommand._fields, command[:4], strict=False):
        if not isinstance(value, int | float | np.number) or not isfinite(value):
            return invalid_command_error(controller, field, value, time_s, WANTED)
    return invalid_command_error(
        controller,
        "divide_by",
        command[4],
        time_s,
        f"{n_discs} finite factors above 0, one for each disc, or ()",
    )
