"""Choose the next plate sweep: the one in which rival explanations differ most.

The points of each option are worked out with one rival taken for true, and the other is fitted to
them with everything within its tolerance free. What remains in the sum of squares is what the sweep
is expected to tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchtool.explain.engine.hypotheses import Hypotheses
from benchtool.explain.engine.verdict import NextExperiment
from benchtool.explain.sweep.evidence import SweepEvidence
from benchtool.explain.sweep.log import SweepLog
from benchtool.explain.sweep.plan import ProposedSweep, SweepOption, points_of, proposed

Array = NDArray[np.float64]

OPTIONS = (
    SweepOption(
        name="next_distances",
        title="Near and far distances together, two levels",
        reason="offset, neighbours, body lift, blockage and the coefficient grow differently "
        "towards the plate",
        z_over_R=(0.5, 0.65, 0.85, 1.2, 1.7, 2.5, 4.0, 6.5),
        repeats=4,
        tare_minutes=4.0,
    ),
    SweepOption(
        name="next_levels",
        title="Four levels up and down at a near and a far place, a tare every two minutes",
        reason="the zero, its creep, the cell's hysteresis and the exponent differ in how they go "
        "with the level, its order and the time since a tare",
        z_over_R=(1.0, 3.0),
        levels=4,
        repeats=6,
        tare_minutes=2.0,
    ),
    SweepOption(
        name="next_aside",
        title="The plate aside at two distances, discs still over it",
        reason="a tilted plate comes nearer on one side, an offset on both alike",
        z_over_R=(0.75, 1.5),
        aside_over_R=(0.0, 2.0, -2.0),
        repeats=4,
        tare_minutes=4.0,
    ),
    SweepOption(
        name="next_edges",
        title="The plate's edge under the discs at one near distance",
        reason="area factors show where a disc is partly covered, and nowhere else",
        z_over_R=(0.6, 0.9),
        inside_over_R=(-0.4, 0.0, 0.4),
        repeats=2,
        tare_minutes=4.0,
    ),
    SweepOption(
        name="next_long",
        title="Two levels at one place again and again for ten minutes, one tare",
        reason="a battery, a creeping zero and warm air go with the clock and with nothing else",
        z_over_R=(1.0,),
        repeats=24,
    ),
)
"""What is weighed. Distances in both directions and levels up and down in all of them."""


def next_sweep_experiment(
    evidence: SweepEvidence, rivals: Sequence[tuple[str, Array]]
) -> NextExperiment | None:
    """Return the sweep in which the two likeliest rivals differ most.

    Args:
        evidence: that the knobs belong to.
        rivals: effects with the knobs (n_knobs,) of their best fits, likeliest first.
    """
    if len(rivals) < 2:
        return None
    expected: dict[str, float] = {}
    sweeps: dict[str, ProposedSweep] = {}
    for option in OPTIONS:
        sweep = proposed(option, evidence)
        sweeps[option.name] = sweep
        expected[option.name] = _expected(sweep, evidence, rivals[0], rivals[1])
    best = max(expected, key=lambda name: expected[name])
    chosen = sweeps[best].option
    names = tuple(name for name, _ in rivals)
    return NextExperiment(
        candidates=names,
        title=chosen.title,
        reason=f"{chosen.reason}; expected to tell {names[0]} from {names[1]}",
        schedule=None,
        plan_toml=sweeps[best].toml(),
        expected=dict(sorted(expected.items(), key=lambda item: -item[1])),
    )


def _expected(
    sweep: ProposedSweep,
    evidence: SweepEvidence,
    first: tuple[str, Array],
    second: tuple[str, Array],
) -> float:
    """Return the log-likelihood ratio that a sweep should give the first rival if it is true."""
    log = as_read(points_of(sweep, evidence), evidence, first[1])
    hypotheses = Hypotheses(evidence.of(log))
    costs = [hypotheses.fitted((name,), at).cost for name, at in (first, second)]
    return 0.5 * float(costs[1] - costs[0])


def as_read(log: SweepLog, evidence: SweepEvidence, at: Array) -> SweepLog:
    """Return points with what a bench of those knobs (n_knobs,) would show, without noise."""
    sets = at[None, :]
    thrust = evidence.thrusts(log.conditions, sets)[:, 0]
    power = log.power
    if power is not None:
        power = power.as_kept(evidence.kept(log, sets)[:, 0])
    return replace(log, thrust_N=thrust, power=power)
