"""Hysteresis of the load cell: lower readings on loading than on unloading."""

from __future__ import annotations

from benchtool.core.parameter import Prior
from benchtool.core.units import STANDARD_GRAVITY_M_S2
from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number
from benchtool.physics.rig_scaling import scale_rig, weight_scale


def thrust_reading(p: Numbers, i: int, flow: Flow, reading: Quantity) -> Quantity:
    """Return the reading with hysteresis, relative to the load direction at the tare: N."""
    width = p.half_width_N * (1.0 + p.growth * (reading / p.reference_N - 1.0))
    return reading - width * (flow.load_direction - p.tare_direction)


def play_N(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Return the half width of the backlash model of a moving reading: N."""
    return p.half_width_N


EFFECT = Effect(
    name="load_cell_hysteresis",
    title="Load-cell hysteresis",
    description=(
        "A reading is lower if the load was approached from below. Causes: friction in the test "
        "stand, and the load cell."
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
            "half the difference of unloading and loading readings at the reference load",
            neutral=0.0, within=(0.0, 5.0),
        ),
        number(
            "tare_direction", "1", -1.0,
            "load direction d at the tare: -1 after thrust, 0 for a cell never loaded",
            within=(-1.0, 1.0), source="convention: tare after the motors have run",
        ),
        number(
            "growth", "1", 0.0, "relative increase s of the width at twice the reference load",
            within=(-1.0, 1.0),
            prior=Prior("normal", 0.0, 0.15, "assumed: data sheets state one width, at full load"),
            source="0: loop of constant width (backlash, dry friction)",
        ),
        number(
            "reference_N", "N", 10.0, "reference load of the half width", within=(0.01, 1e4),
            source="convention; used only if s is not 0",
        ),
    ),
    hooks=Hooks(thrust_reading=thrust_reading, play_N=play_N),
    shows="throttle levels up and down at one plate position",
    source=(
        "definition of hysteresis in load-cell data sheets; constant width (backlash, dry "
        "friction) assumed"
    ),
    confused_with={
        "tare_offset": "tare rows, and levels in rising and falling order, separate them",
        "load_cell_drift": "levels in mixed order separate them",
    },
    benches=frozenset({"sweep"}),
    acts_in_flight=False,
    rig_values=lambda rig: {"reference_N": max(STANDARD_GRAVITY_M_S2 * rig.body.mass_kg, 0.01)},
    tolerance_of=scale_rig(weight_scale, half_width_N=0.02),  # assumed
)  # fmt: skip
