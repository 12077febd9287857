"""First-order lag of rotor speed behind its command."""

from __future__ import annotations

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number


def lag_s(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Return the time constant: s."""
    return p.tau_s


EFFECT = Effect(
    name="motor_lag",
    description="Motor, ESC and rotor inertia make the speed lag behind the pulse width.",
    subsystem="pwm_to_rpm",
    order=20,
    law="d(speed)/dt = (commanded - speed) / tau",
    parameters=(
        number(
            "tau_s", "s", 0.0, "time constant of the whole lag", neutral=0.0, within=(0.0, 1.0),
            tolerance=0.002, source="neutral value; else from the rig",
        ),
    ),
    hooks=Hooks(lag_s=lag_s),
    shows="changes of pulse width; never on a settled bench",
    source="first-order model, usual for small brushless motors",
    confused_with={"transport_delay": "dither above 5 Hz, or rpm telemetry, separates them"},
    benches=frozenset({"pitch"}),
    rig_values=lambda rig: {"tau_s": rig.propulsion.lag_s},
)  # fmt: skip
