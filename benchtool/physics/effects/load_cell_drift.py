"""The load cell's zero creeps after the tare."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from benchtool.core.rig import Rig
from benchtool.physics.effects.effect import (
    BenchKind,
    Effect,
    Flow,
    Hooks,
    Quantity,
    expression,
    number,
)
from benchtool.physics.size import weight_scale


class P(NamedTuple):
    rate_N_per_s: Any


@expression
def thrust_reading(p: P, i: int, flow: Flow, reading: Quantity) -> Quantity:
    """Return the reading with the zero on it that has crept since the tare: N."""
    return reading + p.rate_N_per_s * flow.elapsed_s


def tolerance_of(rig: Rig, bench: BenchKind) -> Mapping[str, float]:
    """Return the creep that matters (a guess), in the measure of the weight: N/s."""
    return {"rate_N_per_s": 1e-4 * weight_scale(rig)}


EFFECT = Effect(
    name="load_cell_drift",
    title="Load-cell drift",
    description="Warming and creep move the load cell's zero steadily after the tare.",
    subsystem="sensor",
    order=40,
    law="reading = thrust + rate * (time since tare)",
    numbers=P,
    parameters=(
        number("rate_N_per_s", "N/s", 0.0, "creep of the zero", neutral=0.0, within=(-0.1, 0.1)),
    ),
    hooks=Hooks(thrust_reading=thrust_reading),
    shows="late after a tare; anchor points walk away",
    source="linear creep, the usual first approximation for strain-gauge cells",
    confused_with={
        "battery_sag": "the voltage column, or anchors at zero throttle, separate them",
        "tare_offset": "points soon and late after a tare separate them",
    },
    separated_by={
        "tare_offset.thrust_N": "anchor points repeated over a longer time since the tare",
        "k": "anchor points repeated over a longer time",
    },
    trends_over=("order", "time_s", "elapsed_s"),
    benches=frozenset({"sweep"}),
    acts_in_flight=False,
    tolerance_of=tolerance_of,
)
