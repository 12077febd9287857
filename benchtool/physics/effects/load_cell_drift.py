"""The load cell's zero creeps after the tare."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from benchtool.core.parameter import Parameter
from benchtool.core.rig import Rig
from benchtool.physics.effects.effect import BenchKind, Effect, Flow, OwnState, Quantity, Values
from benchtool.physics.expression import expression
from benchtool.physics.size import weight_scale


@expression
def rate(state: Quantity, drive: Quantity, p: Values) -> Quantity:
    """Return the creep of the zero: N/s."""
    return p[0]


@expression
def settled(drive: Quantity, elapsed_s: Quantity, p: Values) -> Quantity:
    """Return how far the zero has crept since the tare: N."""
    return p[0] * elapsed_s


@expression
def thrust_reading(
    reading: Quantity, flow: Flow, states: Sequence[Quantity], p: Values
) -> Quantity:
    """Return the reading with the crept zero on it: N."""
    return reading + states[0]


def tolerance_of(rig: Rig, bench: BenchKind) -> Mapping[str, float]:
    """Return the creep that matters (a guess), in the measure of the weight: N/s."""
    return {"rate_N_per_s": 1e-4 * weight_scale(rig)}


EFFECT = Effect(
    name="load_cell_drift",
    title="Load-cell drift",
    description="Warming and creep move the load cell's zero steadily after the tare.",
    stage="sensor",
    law="reading = thrust + rate * (time since tare)",
    parameters=(
        Parameter(
            "rate_N_per_s",
            "N/s",
            0.0,
            neutral=0.0,
            lower=-0.1,
            upper=0.1,
            description="creep of the zero",
            source="neutral value",
        ),
    ),
    shows="late after a tare; anchor points walk away",
    source="linear creep, the usual first approximation for strain-gauge cells",
    confused_with={
        "battery_sag": "the voltage column, or anchors at zero throttle, separate them",
        "tare_offset": "points soon and late after a tare separate them",
    },
    benches=frozenset({"sweep"}),
    separated_by={
        "tare_offset.thrust_N": "anchor points repeated over a longer time since the tare",
        "k": "anchor points repeated over a longer time",
    },
    trends_over=("order", "time_s", "elapsed_s"),
    tolerance_of=tolerance_of,
    readings={"thrust_N": thrust_reading},
    states=(
        OwnState(
            name="zero",
            drive="none",
            rate=rate,
            settled=settled,
        ),
    ),
)
