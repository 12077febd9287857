"""Random torque from the rotors' wakes."""

from __future__ import annotations

from benchtool.aero.expression import expression
from benchtool.core.parameter import Parameter
from benchtool.effects.effect import Effect, Quantity, Values


@expression
def random_torque(p: Values) -> tuple[Quantity, Quantity]:
    """Return standard deviation (N m) and correlation time (s)."""
    return p[0], p[1]


EFFECT = Effect(
    name="wake_torque",
    title="Wake torque",
    description="Turbulence of the rotors' wakes pushes the beam about at random.",
    stage="hinge",
    law="Ornstein-Uhlenbeck process of that standard deviation and correlation time",
    parameters=(
        Parameter(
            "sd_Nm",
            "N m",
            0.0,
            neutral=0.0,
            lower=0.0,
            upper=10.0,
            tolerance=0.002,
            description="standard deviation of the random torque",
            source="neutral value",
        ),
        Parameter(
            "correlation_s",
            "s",
            0.1,
            neutral=None,
            lower=0.0001,
            upper=100.0,
            description="correlation time of the random torque",
            source="assumed",
        ),
    ),
    shows="always; coloured residuals of torque",
    source="Ornstein-Uhlenbeck, the simplest coloured noise; an assumption",
    confused_with={},
    candidate=False,
    random_torque=random_torque,
)
