"""Loss of speed at a given pulse width as the battery discharges."""

from __future__ import annotations

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number


def speed(p: Numbers, i: int, flow: Flow, speed_rad_s: Quantity) -> Quantity:
    """Return the speed with a gain that decreases linearly with time: rad/s."""
    return speed_rad_s * (1.0 - p.rate_per_s * flow.time_s)


TOLERATED_LOSS = 0.015  # relative loss of gain in a run: 0.0005 1/s over 30 s, from a bench owner
TYPICAL_DURATION_S = {"pitch": 30.0, "sweep": 600.0}  # sweep: assumed


EFFECT = Effect(
    name="battery_sag",
    description="The voltage, and the speed at a given pulse width, decrease during the run.",
    subsystem="pwm_to_rpm",
    order=40,
    law="speed = gain * pulse * (1 - rate * t)",
    parameters=(
        number(
            "rate_per_s", "1/s", 0.0, "linear loss of the pwm-to-rpm gain", neutral=0.0,
            within=(0.0, 0.01),  # a battery only discharges
        ),
    ),
    hooks=Hooks(speed=speed),
    shows="late in the run, at high throttle; the voltage column shows it first",
    source="linear loss over a few minutes; assumed for longer runs",
    confused_with={"load_cell_drift": "the voltage column and rpm separate them"},
    supply_loss="rate_per_s",
    always_compiled=True,
    tolerance_of=lambda rig, bench: {"rate_per_s": TOLERATED_LOSS / TYPICAL_DURATION_S[bench]},
)  # fmt: skip
