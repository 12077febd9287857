"""Random torque from the rotors' wakes."""

from __future__ import annotations

from collections.abc import Mapping

from benchtool.core.parameter import Parameter
from benchtool.core.rig import Rig
from benchtool.physics.effects.effect import BenchKind, Effect, Quantity, Values
from benchtool.physics.expression import expression
from benchtool.physics.size import torque_scale


@expression
def random_torque(p: Values) -> tuple[Quantity, Quantity]:
    """Return standard deviation (N m) and correlation time (s)."""
    return p[0], p[1]


def tolerance_of(rig: Rig, bench: BenchKind) -> Mapping[str, float]:
    """Return the torque that matters, in the measure of m g L: N m."""
    return {"sd_Nm": 0.002 * torque_scale(rig)}


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
    benches=frozenset(),
    tolerance_of=tolerance_of,
    random_torque=random_torque,
)
