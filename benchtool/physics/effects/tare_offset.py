"""Constant offset of thrust readings from the tare."""

from __future__ import annotations

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number
from benchtool.physics.rig_scaling import scale_rig, weight_scale


def thrust_reading(p: Numbers, i: int, flow: Flow, reading: Quantity) -> Quantity:
    """Return the reading with the offset: N."""
    return reading + p.thrust_N


EFFECT = Effect(
    name="tare_offset",
    description="Thrust readings have a constant offset, as after a tare under load.",
    subsystem="sensor",
    order=30,
    law="reading = thrust + offset",
    parameters=(
        number("thrust_N", "N", 0.0, "offset of the reading", neutral=0.0, within=(-5.0, 5.0)),
    ),
    hooks=Hooks(thrust_reading=thrust_reading),
    shows="low throttle, zero throttle",
    source="definition of a tare",
    confused_with={
        "load_cell_hysteresis": "tare rows, and levels in rising and falling order, separate them"
    },
    separated_by={
        "k": "several throttle levels, among them a low one",
        "calibration.offset_N": "a tare with the motors off",
    },
    trends_over=("speed_rad_s",),
    benches=frozenset({"sweep"}),
    acts_in_flight=False,
    tolerance_of=scale_rig(weight_scale, thrust_N=0.02),  # assumed
)
