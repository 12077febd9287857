"""A flight under a controller of the user's own: the same loop, stopped at every period."""

from __future__ import annotations

from math import inf, isfinite
from typing import Any

import numpy as np

from benchtool.core.array import Array
from benchtool.core.errors import InputError
from benchtool.physics.expression import compiled
from benchtool.simulate.controllers.controller import (
    FlightCommand,
    FlightController,
    FlightMeasurement,
    FlightReference,
)
from benchtool.simulate.environment import Tables
from benchtool.simulate.flight.flight import Flight, FlightCase, FlightLoop
from benchtool.simulate.flight.ground import COVERAGE, FACTOR, HEIGHT, Discs, look_down
from benchtool.simulate.flight.kernel import AT_GOAL, ENDING, Plan, fly_period, observe
from benchtool.simulate.flight.law import COMMAND, ESTIMATE, TARGET, WRENCH, Airframe, share_out
from benchtool.simulate.gathered import gathered, line, plane, solid
from benchtool.simulate.own_controller import raised, unusable

WANTED = "a FlightCommand(thrust_N, roll_Nm, pitch_Nm, yaw_Nm) of finite numbers"


@compiled
def own_period(block: Array, places: Plan, plan: Plan, period: int) -> None:
    """Fly one control period of a wrench in the memory and factors in the guess; sense the next.

    Period -1 only senses the first.

    Args:
        block: from `gathered`, in the order of `_arrays`.
        places: the same.
        plan: as `fly_loop` has it.
        period: to fly.
    """
    state, memory, speeds = line(block, places, 0), line(block, places, 1), line(block, places, 2)
    seen, noise, goals = line(block, places, 3), plane(block, places, 4), plane(block, places, 5)
    gusts, log = plane(block, places, 6), plane(block, places, 7)
    ground, guess = plane(block, places, 8), plane(block, places, 9)
    rotors, known = plane(block, places, 10), plane(block, places, 11)
    a, b, d = line(block, places, 12), line(block, places, 13), line(block, places, 14)
    e, f = line(block, places, 15), line(block, places, 16)
    period_s, ramp, whole = a[10], a[11], a[12] > 0.0
    frame = Airframe(rotors, a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8], a[9])
    taken = Airframe(known, b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7], b[8], b[9])
    discs = Discs(plane(block, places, 17), d[0], d[1], d[2], d[3], int(d[4]), d[5])
    below = Tables(
        plane(block, places, 18), solid(block, places, 19), e[0], e[1], e[2], e[3], e[4], int(e[5])
    )
    chart = Tables(
        plane(block, places, 20), solid(block, places, 21), f[0], f[1], f[2], f[3], f[4], int(f[5])
    )
    if period >= 0:
        share_out(memory, guess, 1.0, taken, speeds)
        if fly_period(
            period, period_s, state, frame, discs, below, goals, gusts, plan, log, ground,
            memory, speeds,
        ):  # fmt: skip
            return
    observe(period + 1, period_s, ramp, state, goals, noise, plan, seen)
    look_down((period + 1) * period_s, state, discs, chart, guess, whole)


def _arrays(loop: FlightLoop) -> list[Array]:
    """Return everything that `own_period` takes, in its order."""
    law, discs, below, chart = loop.law, loop.discs, loop.below, loop.chart
    frame = [*loop.frame[1:], law.period_s, law.ramp, float(law.whole)]
    return [
        loop.state, loop.memory, loop.speeds, loop.seen, loop.noise, loop.goals, loop.gusts,
        loop.log, loop.ground, loop.guess, loop.frame.rotors, loop.known.rotors,
        np.array(frame), np.array(loop.known[1:]), np.array(discs[1:], float),
        np.array(below[2:], float), np.array(chart[2:], float),
        discs.table, below.blocks, below.seen, chart.blocks, chart.seen,
    ]  # fmt: skip


def fly_own(case: FlightCase, controller: FlightController, name: str) -> Flight:
    """Fly a case with a controller of the user's own.

    The map that it sees is the case's, with its errors; gains and control of the case do not act,
    but for the gains' control rate.

    Args:
        case: what is flown.
        controller: a new one for every flight.
        name: for tables and figures.

    Raises:
        InputError: as `fly`; or the controller raised, or returned what is no command.
    """
    loop = FlightLoop(case, charted=True)
    # What nobody asks for and nobody estimates stands in no log.
    loop.memory[ESTIMATE : ESTIMATE + 6] = loop.memory[COMMAND : COMMAND + 3] = np.nan
    block, places, views = gathered(_arrays(loop))
    memory, seen, loop.log = views[1], views[3], views[7]
    loop.ground, guess = views[8], views[9]
    plan, n_discs = loop.plan, guess.shape[1]
    period_s, rate_Hz = loop.law.period_s, case.gains.control_rate_Hz
    speeds_m_s = loop.goals[:, 4].tolist()
    yaw_rad, hover_N = float(case.yaw_rad), case.vehicle.hover_thrust_N * case.vehicle.rig.n_rotors
    wrench, factors = memory[WRENCH : WRENCH + 4], guess[FACTOR]
    heights, coverage = guess[HEIGHT], guess[COVERAGE]
    step, new = controller.step, tuple.__new__  # spares the named tuples' own constructors
    own_period(block, places, plan, -1)
    for period in range(loop.n_periods):
        time_s = period / rate_Hz
        read = seen.tolist()
        over, covered = tuple(heights.tolist()), tuple(coverage.tolist())
        measured = new(FlightMeasurement, (time_s, *read[:TARGET], over, covered))
        limit_m_s = speeds_m_s[plan[AT_GOAL]]
        wanted = new(FlightReference, (*read[TARGET:], yaw_rad, limit_m_s, hover_N))
        try:
            command = step(measured, wanted, period_s)
        except (Exception, SystemExit) as error:
            raise raised(controller, error, time_s) from error
        factors[:] = 1.0
        try:
            thrust, roll, pitch, yaw, *rest = command
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
            raise _faulty(controller, command, time_s, n_discs)
        own_period(block, places, plan, period)
        if plan[ENDING]:
            break
    return loop.flight(name)


def _faulty(controller: Any, command: Any, time_s: float, n_discs: int) -> InputError:
    """Return what is wrong with a command, by its field."""
    if not isinstance(command, tuple | list) or not 4 <= len(command) <= 5:
        return unusable(controller, "a command", command, time_s, WANTED)
    for field, value in zip(FlightCommand._fields, command[:4], strict=False):
        if not isinstance(value, int | float | np.number) or not isfinite(value):
            return unusable(controller, field, value, time_s, WANTED)
    return unusable(
        controller,
        "divide_by",
        command[4],
        time_s,
        f"{n_discs} finite factors above 0, one for each disc, or ()",
    )
