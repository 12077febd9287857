"""Random torque from the rotors' wakes."""

from __future__ import annotations

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number
from benchtool.physics.rig_scaling import scale_rig, torque_scale


def random_torque(p: Numbers, i: int, flow: Flow) -> tuple[Quantity, Quantity]:
    """Return standard deviation (N m) and correlation time (s)."""
    return p.sd_Nm, p.correlation_s


EFFECT = Effect(
    name="wake_torque",
    description="Turbulent rotor wakes exert a random torque on the beam.",
    subsystem="hinge",
    order=80,
    law="Ornstein-Uhlenbeck process of that standard deviation and correlation time",
    parameters=(
        number(
            "sd_Nm", "N m", 0.0, "standard deviation of the random torque", neutral=0.0,
            within=(0.0, 10.0),
        ),
        number(
            "correlation_s", "s", 0.1, "correlation time of the random torque",
            within=(0.0001, 100.0), source="assumed",
        ),
    ),
    hooks=Hooks(random_torque=random_torque),
    shows="always; coloured residuals of torque",
    source="assumed: Ornstein-Uhlenbeck, the simplest coloured noise",
    benches=frozenset(),
    tolerance_of=scale_rig(torque_scale, sd_Nm=0.002),
)  # fmt: skip
