"""The loops of a flight, made for a set of effects, a law, and numbers of discs and rotors."""

from __future__ import annotations

from collections import namedtuple
from functools import lru_cache
from typing import Any

from benchtool.physics.disc_thrust import ImageRules, owned
from benchtool.physics.effects.effect import Effect
from benchtool.physics.expression import (
    borrowed,
    compiled_closure,
    expression,
    loop_part,
    read_record,
)
from benchtool.physics.fold import chained, each, identity
from benchtool.simulate.flight.ground import surround
from benchtool.simulate.flight.lane import (
    control_vehicle,
    mix_vehicle,
    move_vehicle,
    sense_vehicle,
    still_going,
)
from benchtool.simulate.flight.records import TICK, FlightArrays, geometry_slot
from benchtool.simulate.hooks import identities, joined_hooks
from benchtool.simulate.kernel import Build, Phases, run_ticks
from benchtool.simulate.layout import Layout

FlightLoops = namedtuple("FlightLoops", "run look")
"""Hold what a flight runs: run(arrays, plan, first, last) -> the tick at which it ended, with
the arrays as `layout.lent`; and look, see `ground.surround`.
"""


@lru_cache(maxsize=64)
def flight_loops(
    effects: tuple[Effect, ...],
    layout: Layout,
    disc_of: tuple[int, ...],
    rules: ImageRules,
    step: Any,
) -> FlightLoops:
    """Return the loops of these effects and this law."""
    n, to = max(disc_of) + 1, layout.places
    ones, n_rotors, like = (1.0,) * n, len(disc_of), FlightArrays()
    hooks = joined_hooks(effects, n, rules)
    slot, build = geometry_slot(n, rules.n_body), Build((0,), to)
    look = surround(n, hooks)
    speed = chained(owned(effects, "speed"))
    rotor_speeds = each(
        n_rotors, expression(lambda i, flow, p: speed(i, flow.speed_rad_s[i], flow, p))
    )
    fixed = expression(lambda a: read_record(a.geometry, slot, 0, 1))
    wanted = loop_part(lambda a, tick: read_record(a.schedule, TICK, tick, a.schedule.shape[1]))
    law = loop_part(lambda a, now: control_vehicle(a, now, to, step))
    mix = loop_part(lambda a, now: mix_vehicle(a, now, to, hooks(), rotor_speeds, disc_of))
    move = loop_part(lambda a, now: move_vehicle(a, now, to, hooks(), look, disc_of, ones))
    sense = loop_part(lambda a, now: sense_vehicle(a, now, to, hooks(), look, disc_of, ones))
    goes_on = loop_part(lambda a: still_going(a, to))
    phases: Any = expression(lambda: Phases(fixed, wanted, law, mix, move, sense, goes_on))
    key = repr((disc_of, rules, identity(step), layout.records, identities(effects)))

    def run(arrays: Any, plan: Any, first: Any, last: Any) -> Any:
        return run_ticks(borrowed(arrays, like), plan, first, last, build, phases())

    return FlightLoops(compiled_closure(run, key), look)
