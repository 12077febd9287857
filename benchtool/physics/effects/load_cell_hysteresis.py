"""The load cell shows less on the way up than on the way down."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from benchtool.core.parameter import Prior
from benchtool.core.rig import Rig
from benchtool.core.units import STANDARD_GRAVITY_M_S2
from benchtool.physics.effects.effect import Effect, Flow, Hooks, Quantity, expression, number
from benchtool.physics.rig_scaling import scale_rig, weight_scale

GROWTH_KNOWN = Prior("normal", 0.0, 0.15, "assumed: data sheets state one width, at full load")


@expression
def thrust_reading(p: Any, i: int, flow: Flow, reading: Quantity) -> Quantity:
    """Return the reading behind a play: low after a rise, against the direction of the tare: N."""
    width = p.half_width_N * (1.0 + p.growth * (reading / p.reference_N - 1.0))
    return reading - width * (flow.load_direction - p.tare_direction)


@expression
def play_N(p: Any, i: int, flow: Flow) -> Quantity:
    """Return the half width of the play that a moving reading stays behind: N."""
    return p.half_width_N


def rig_values(rig: Rig) -> Mapping[str, float]:
    """Return the rig's weight as the load at which the half width holds: N."""
    return {"reference_N": STANDARD_GRAVITY_M_S2 * rig.body.mass_kg}


EFFECT = Effect(
    name="load_cell_hysteresis",
    title="Load-cell hysteresis",
    description=(
        "A load reads lower when it was approached from a smaller one than from a greater one; "
        "friction in the stand and the cell itself do it."
    ),
    subsystem="sensor",
    order=50,
    law=(
        "reading = thrust - h (1 + s (thrust/ref - 1)) (d - d_tare), d = +1 approached from below, "
        "-1 from above"
    ),
    parameters=(
        number(
            "half_width_N", "N", 0.0,
            "half the difference between the way down and the way up at the reference", neutral=0.0,
            within=(0.0, 5.0),
        ),
        number(
            "tare_direction", "1", -1.0,
            "direction d of the load at the tare: -1 after thrust, 0 on a fresh cell",
            within=(-1.0, 1.0), source="convention: a bench is tared after its motors have run",
        ),
        number(
            "growth", "1", 0.0, "share s by which the loop is wider at twice the reference load",
            within=(-1.0, 1.0), prior=GROWTH_KNOWN,
            source="0: a loop of constant width (play, dry friction)",
        ),
        number(
            "reference_N", "N", 10.0, "load at which the half width holds", within=(0.01, 1e4),
            source="convention; it matters only where the loop grows",
        ),
    ),
    hooks=Hooks(thrust_reading=thrust_reading, play_N=play_N),
    shows="levels visited up and down at one place",
    source=(
        "definition of hysteresis in load-cell data sheets; a loop of constant width (play, dry "
        "friction) is a guess"
    ),
    confused_with={
        "tare_offset": "tare rows and up-and-down order separate them",
        "load_cell_drift": "levels in mixed order separate them",
    },
    benches=frozenset({"sweep"}),
    acts_in_flight=False,
    rig_values=rig_values,
    tolerance_of=scale_rig(weight_scale, half_width_N=0.02),  # a guess
)  # fmt: skip
