"""The loops of a flight, made for a set of effects, a law, and numbers of discs and rotors."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from benchtool.physics.disc_thrust import owned
from benchtool.physics.effects.effect import Effect
from benchtool.physics.expression import (
    borrowed,
    compiled_closure,
    expression,
    loop_part,
    read_record,
)
from benchtool.physics.fold import chained, each, identity
from benchtool.simulate.flight.environment import Tables
from benchtool.simulate.flight.ground import surround
from benchtool.simulate.flight.lane import (
    control_vehicle,
    mix_vehicle,
    move_vehicle,
    sense_vehicle,
    still_going,
)
from benchtool.simulate.flight.records import FlightArrays, geometry_slot
from benchtool.simulate.hooks import identities, joined_hooks
from benchtool.simulate.kernel import Phases, run_ticks
from benchtool.simulate.layout import Layout, in_one_block, line, plane, solid


class FlightBuild(NamedTuple):
    """Hold what a loop is compiled for: one entry per lane, and where records stand."""

    lanes: Any
    to: Any


class FlightLoops(NamedTuple):
    """Hold the loops of a flight.

    Attributes:
        run: run(arrays, plan, first, last) -> the tick at which it ended.
        tick: tick(block, places, plan, first, last), the same with the arrays in one block.
        look: see `ground.surround`.
    """

    run: Any
    tick: Any
    look: Any


def packed(arrays: FlightArrays) -> tuple[Any, Any]:
    """Return the arrays in one block, and where each stands: see `in_one_block`."""
    *single, below, chart = arrays
    block, places, _ = in_one_block([*single, *below, *chart])
    return block, places


@loop_part
def unpacked(block: Any, places: Any) -> FlightArrays:
    """Return the arrays that `packed` put into a block, as views."""
    return FlightArrays(
        line(block, places, 0),
        line(block, places, 1).view(np.int64),
        solid(block, places, 2),
        solid(block, places, 3),
        line(block, places, 4).view(np.int64),
        plane(block, places, 5),
        plane(block, places, 6),
        plane(block, places, 7),
        plane(block, places, 8),
        line(block, places, 9),
        Tables(plane(block, places, 10), solid(block, places, 11), line(block, places, 12)),
        Tables(plane(block, places, 13), solid(block, places, 14), line(block, places, 15)),
    )


@lru_cache(maxsize=64)
def flight_loops(
    effects: tuple[Effect, ...],
    layout: Layout,
    disc_of: tuple[int, ...],
    rule: str,
    arms: tuple[int, ...],
    step: Any,
) -> FlightLoops:
    """Return the loops of these effects and this law.

    Args:
        effects: whose hooks are called.
        layout: where records stand.
        disc_of: on which disc each rotor is (n_rotors,).
        rule: wake rule.
        arms: how many images of eq. (4) are equally far, see `disc_thrust`.
        step: of the law that controls.
    """
    n, to = max(disc_of) + 1, layout.places
    ones, n_rotors = (1.0,) * n, len(disc_of)
    hooks = joined_hooks(effects, n, rule, arms)
    slot, build = geometry_slot(n, len(arms)), FlightBuild((0,), to)
    look = surround(n, hooks)
    speed = chained(owned(effects, "speed"))
    rotor_speeds = each(
        n_rotors, expression(lambda i, flow, p: speed(i, flow.speed_rad_s[i], flow, p))
    )
    fixed = expression(lambda a: read_record(a.geometry, slot, 0, 1))
    law = loop_part(lambda a, lane, now: control_vehicle(a, now, to, step))
    mix = loop_part(lambda a, lane, now: mix_vehicle(a, now, to, hooks(), rotor_speeds, disc_of))
    move = loop_part(lambda a, lane, now: move_vehicle(a, now, to, hooks(), look, disc_of, ones))
    sense = loop_part(lambda a, lane, now: sense_vehicle(a, now, to, hooks(), look, disc_of, ones))
    goes_on = loop_part(lambda a: still_going(a, to))
    phases: Any = expression(lambda: Phases(fixed, law, mix, move, sense, goes_on))
    key = repr((disc_of, rule, arms, identity(step), layout.records, identities(effects)))

    def run(arrays: Any, plan: Any, first: Any, last: Any) -> Any:
        return run_ticks(borrowed(arrays), plan, first, last, build, phases())

    def tick(block: Any, places: Any, plan: Any, first: Any, last: Any) -> Any:
        return run_ticks(
            unpacked(borrowed(block), borrowed(places)), plan, first, last, build, phases()
        )

    return FlightLoops(compiled_closure(run, key), compiled_closure(tick, key), look)
