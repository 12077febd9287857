"""The pitch bench's loops, made for a set of effects, a law, and numbers of discs and lanes."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

from benchtool.physics.effects.effect import Effect
from benchtool.physics.expression import borrowed, compiled_closure
from benchtool.physics.fold import identity
from benchtool.simulate.controllers.controller import PitchLaw
from benchtool.simulate.hooks import identities, joined_hooks
from benchtool.simulate.layout import Layout
from benchtool.simulate.pitch.filter_ticks import filter_ticks
from benchtool.simulate.pitch.kernel import Build, run_ticks, unpacked_arrays
from benchtool.simulate.pitch.records import geometry_slot, tick_slot


class Loops(NamedTuple):
    """Hold compiled loops: run(arrays, plan, first, last), tick(block, places, plan, number), and
    filter(arrays, plan, first, last, logged, gains, before).
    """

    run: Any
    tick: Any
    filter: Any


@lru_cache(maxsize=64)
def pitch_loops(
    effects: tuple[Effect, ...],
    layout: Layout,
    n_discs: int,
    lanes: int,
    rule: str,
    arms: tuple[int, ...],
    law: PitchLaw,
) -> Loops:
    """Return the loops of these effects and this law.

    Args:
        effects: whose hooks are called, from `loop_effects`.
        layout: where records stand.
        n_discs: of the rig.
        lanes: how many benches run side by side.
        rule: wake rule.
        arms: how many images of eq. (4) are equally far, see `disc_thrust`.
        law: what controls.
    """
    build = Build(
        tuple(range(lanes)), layout.places, tick_slot(n_discs), geometry_slot(n_discs, len(arms)),
        (1.0,) * n_discs,
    )  # fmt: skip
    hooks, step = joined_hooks(effects, n_discs, rule, arms), law.step
    key = repr((n_discs, lanes, rule, arms, identity(step), layout.records, identities(effects)))

    def run(arrays: Any, plan: Any, first: Any, last: Any) -> None:
        run_ticks(borrowed(arrays), plan, first, last, build, step, hooks())

    def tick(block: Any, places: Any, plan: Any, number: Any) -> None:
        arrays = unpacked_arrays(borrowed(block), borrowed(places))
        run_ticks(arrays, plan, number, number + 1, build, step, hooks())

    def filter_(
        arrays: Any, plan: Any, first: Any, last: Any, logged: Any, gains: Any, before: Any
    ) -> None:
        filter_ticks(borrowed(arrays), plan, first, last, logged, gains, before, build, hooks())

    return Loops(*(compiled_closure(loop, key) for loop in (run, tick, filter_)))
