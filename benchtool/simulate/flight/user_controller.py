"""Flight with a user-defined controller: the same loop, one call per period."""

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

COMMAND_REMEDY = "a FlightCommand(thrust_N, roll_Nm, pitch_Nm, yaw_Nm) of finite numbers"


def fly_user_controller(case: FlightCase, controller: FlightController, name: str) -> Flight:
    """Fly a case with a user-defined controller.

    It gets the map of the case, with its errors. Of gains and control of the case, only the control
    rate of the gains has an effect.

    Raises:
        InputError: as `fly`; or the controller raised, or returned an invalid command.
    """
    loop = FlightLoop(case, external=True)
    run, plan, n_discs = loop.loops.run, loop.plan, case.vehicle.rig.n_discs
    arrays = lend_rows(run, loop.arrays)
    n_scalars, rate_Hz = len(FlightMeasurement._fields) - 2, case.gains.control_rate_Hz
    measured_view, command_view = loop.view("measured"), loop.view("command")
    wrench, factors = command_view[:4], command_view[4:]
    references = loop.arrays.schedule[tick_rows("reference")].T.tolist()
    step, new = controller.step, tuple.__new__  # faster than the constructors of the named tuples
    run(arrays, plan, -1, 0)
    for period in range(loop.n_ticks):
        time_s = period / rate_Hz
        numbers = measured_view.tolist()
        heights_m, coverages = tuple(numbers[n_scalars:-n_discs]), tuple(numbers[-n_discs:])
        measured = new(FlightMeasurement, (time_s, *numbers[1:n_scalars], heights_m, coverages))
        try:
            command = step(measured, new(FlightReference, references[period]), 1.0 / rate_Hz)
        except (Exception, SystemExit) as error:
            raise controller_error(controller, error, time_s) from error
        factors[:] = 1.0
        try:
            thrust, roll, pitch, yaw, *extra = command
            wrench[0], wrench[1], wrench[2], wrench[3] = thrust, roll, pitch, yaw
            is_valid = isfinite(thrust + roll + pitch + yaw)
            if extra and extra != [()]:
                (divide_by,) = extra
                factors[:] = divide_by
                is_valid = is_valid and len(divide_by) == n_discs
                is_valid = is_valid and all(0.0 < factor < inf for factor in divide_by)
        except (TypeError, ValueError):
            is_valid = False
        if not is_valid:
            raise _invalid_field_error(controller, command, time_s, n_discs)
        loop.ended = run(arrays, plan, period, period + 1)
        if loop.ended == period:
            break
    return loop.flight(name)


def _invalid_field_error(controller: Any, command: Any, time_s: float, n_discs: int) -> InputError:
    """Return an error about the first invalid field of a command."""
    if not isinstance(command, tuple | list) or not 4 <= len(command) <= 5:
        return invalid_command_error(controller, "a command", command, time_s, COMMAND_REMEDY)
    for field, value in zip(FlightCommand._fields, command[:4], strict=False):
        if not isinstance(value, int | float | np.number) or not isfinite(value):
            return invalid_command_error(controller, field, value, time_s, COMMAND_REMEDY)
    return invalid_command_error(
        controller,
        "divide_by",
        command[4],
        time_s,
        f"{n_discs} finite factors above 0, one per disc, or ()",
    )
