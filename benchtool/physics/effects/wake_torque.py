"""Random torque from the rotors' wakes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

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
from benchtool.physics.size import torque_scale


class P(NamedTuple):
    sd_Nm: Any
    correlation_s: Any


@expression
def random_torque(p: P, i: int, flow: Flow) -> tuple[Quantity, Quantity]:
    """Return standard deviation (N m) and correlation time (s)."""
    return p.sd_Nm, p.correlation_s


def tolerance_of(rig: Rig, bench: BenchKind) -> Mapping[str, float]:
    """Return the torque that matters, in the measure of m g L: N m."""
    return {"sd_Nm": 0.002 * torque_scale(rig)}


EFFECT = Effect(
    name="wake_torque",
    title="Wake torque",
    description="Turbulence of the rotors' wakes pushes the beam about at random.",
    subsystem="hinge",
    order=80,
    law="Ornstein-Uhlenbeck process of that standard deviation and correlation time",
    numbers=P,
    parameters=(
        number(
            "sd_Nm",
            "N m",
            0.0,
            "standard deviation of the random torque",
            neutral=0.0,
            within=(0.0, 10.0),
        ),
        number(
            "correlation_s",
            "s",
            0.1,
            "correlation time of the random torque",
            within=(0.0001, 100.0),
            source="assumed",
        ),
    ),
    hooks=Hooks(random_torque=random_torque),
    shows="always; coloured residuals of torque",
    source="Ornstein-Uhlenbeck, the simplest coloured noise; an assumption",
    confused_with={},
    benches=frozenset(),
    tolerance_of=tolerance_of,
)
