"""The speed that a pulse gives falls as the battery empties."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

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


@expression
def speed(p: Any, i: int, flow: Flow, speed_rad_s: Quantity) -> Quantity:
    """Return the speed after a linear loss of the gain with time: rad/s."""
    return speed_rad_s * (1.0 - p.rate_per_s * flow.time_s)


LOSS_THAT_MATTERS = 0.015  # share of the gain in a run: 0.0005 1/s over 30 s, from a bench owner
RUN_S: Mapping[BenchKind, float] = {"pitch": 30.0, "sweep": 600.0}  # of a recording; sweep: assumed


def tolerance_of(rig: Rig, bench: BenchKind) -> Mapping[str, float]:
    """Return the rate that loses as much by the end of a usual run on that bench: 1/s."""
    return {"rate_per_s": LOSS_THAT_MATTERS / RUN_S[bench]}


EFFECT = Effect(
    name="battery_sag",
    title="Battery sag",
    description="Voltage falls during the run, and with it the speed at a given pulse width.",
    subsystem="pwm_to_rpm",
    order=40,
    law="speed = gain * pulse * (1 - rate * t)",
    parameters=(
        number(
            "rate_per_s",
            "1/s",
            0.0,
            "linear loss of the pwm-to-rpm gain",
            neutral=0.0,
            within=(0.0, 0.01),  # a battery only ever empties
        ),
    ),
    hooks=Hooks(speed=speed),
    shows="late in the run, at high throttle; the voltage column shows it first",
    source="linear loss over a few minutes; a guess for longer runs",
    confused_with={"load_cell_drift": "the voltage column and rpm separate them"},
    supply_loss="rate_per_s",
    always_compiled=True,
    tolerance_of=tolerance_of,
)
