"""Zero drift of the load cell after the tare."""

from __future__ import annotations

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number
from benchtool.physics.rig_scaling import scale_rig, weight_scale


def thrust_reading(p: Numbers, i: int, flow: Flow, reading: Quantity) -> Quantity:
    """Return the reading including the zero drift since the tare: N."""
    return reading + p.rate_N_per_s * flow.elapsed_s


EFFECT = Effect(
    name="load_cell_drift",
    title="Load-cell drift",
    description="Warming and creep change the load cell's zero linearly after the tare.",
    subsystem="sensor",
    order=40,
    law="reading = thrust + rate * (time since tare)",
    parameters=(
        number("rate_N_per_s", "N/s", 0.0, "zero drift rate", neutral=0.0, within=(-0.1, 0.1)),
    ),
    hooks=Hooks(thrust_reading=thrust_reading),
    shows="long after a tare; drift of the anchor points",
    source="linear creep, first approximation for strain-gauge cells",
    confused_with={
        "battery_sag": "the voltage column, or anchors at zero throttle, separate them",
        "tare_offset": "points shortly and long after a tare separate them",
    },
    separated_by={
        "tare_offset.thrust_N": "anchor points repeated over a longer time since the tare",
        "k": "anchor points repeated over a longer time",
    },
    trends_over=("order", "time_s", "elapsed_s"),
    benches=frozenset({"sweep"}),
    acts_in_flight=False,
    tolerance_of=scale_rig(weight_scale, rate_N_per_s=1e-4),  # assumed
)
