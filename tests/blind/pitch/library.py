"""The effects that can be hidden one by one or in pairs: parameter, neutral value, tolerance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tests.blind.families import RANGES, Stage, Strength
from tests.blind.pitch.plant import Plant
from tests.blind.pitch.sheet import SHEET


@dataclass(frozen=True, slots=True, kw_only=True)
class Named:
    """Describe one effect that has a name."""

    name: str  # of the effect
    stage: Stage  # where between pulse and reading it acts
    parameter: str  # of the effect, with its unit in the name where it has one
    field: str  # of the plant that holds it
    neutral: float  # value at which the effect is absent
    tolerance: float  # departure that the bench's owner does not mind
    most_below: float = 8.0  # greatest size below neutral, in tolerances; 0: physics allows none
    most_above: float = 8.0  # greatest size above neutral

    def hide(self, rng: np.random.Generator, strength: Strength) -> Hidden:
        """Draw a size and a side."""
        low, high = RANGES[strength]
        sides = [side for side in (-1.0, 1.0) if (self.most_below, self.most_above)[side > 0] > 0]
        side = float(rng.choice(sides))
        high = min(high, self.most_above if side > 0 else self.most_below)
        size = side * float(rng.uniform(low, high))
        return Hidden(
            name=self.name,
            parameter=self.parameter,
            value=self.neutral + size * self.tolerance,
            size=size,
        )

    def put_into(self, plant: Plant, value: float) -> Plant:
        """Return the plant with this effect at that value, whatever it was before."""
        changed: dict[str, Any] = {self.field: value}
        return replace(plant, **changed)


@dataclass(frozen=True, slots=True, kw_only=True)
class Hidden:
    """Hold one hidden effect: its name, and its value, also in tolerances past neutral."""

    name: str
    parameter: str
    value: float
    size: float


_ALL = (
    Named(
        name="coulomb_friction",
        stage="hinge",
        parameter="torque_Nm",
        field="friction_Nm",
        neutral=0.0,
        tolerance=0.002,
        most_below=0.0,
    ),
    Named(
        name="viscous_friction",
        stage="hinge",
        parameter="damping_Nms",
        field="damping_Nms",
        neutral=0.0,
        tolerance=0.004,
        most_below=0.0,
    ),
    Named(
        name="hinge_spring",
        stage="hinge",
        parameter="stiffness_Nm_per_rad",
        field="stiffness_Nm_per_rad",
        neutral=0.0,
        tolerance=0.02,
    ),
    Named(
        name="cog_offset",
        stage="hinge",
        parameter="x_m",
        field="cog_x_m",
        neutral=0.0,
        tolerance=0.0005,
    ),
    Named(
        name="motor_lag",
        stage="pwm_to_rpm",
        parameter="tau_s",
        field="tau_s",
        neutral=SHEET.tau_m,
        tolerance=0.002,
    ),
    Named(
        name="transport_delay",
        stage="pwm_to_rpm",
        parameter="delay_s",
        field="delay_s",
        neutral=0.0,
        tolerance=0.002,
        most_below=0.0,
    ),
    Named(
        name="rotor_asymmetry",
        stage="rpm_to_thrust",
        parameter="ratio",
        field="thrust_ratio",
        neutral=1.0,
        tolerance=0.015,
    ),
    # The plate is never read so far off that the covered rotor would hit it.
    Named(
        name="plate_offset",
        stage="plate",
        parameter="dz_m",
        field="plate_dz_m",
        neutral=0.0,
        tolerance=0.003,
        most_below=5.0,
    ),
    Named(
        name="battery_sag",
        stage="pwm_to_rpm",
        parameter="rate_per_s",
        field="sag_per_s",
        neutral=0.0,
        tolerance=0.0005,
        most_below=0.0,
    ),
    Named(
        name="gyro_bias",
        stage="sensor",
        parameter="bias_rad_s",
        field="gyro_bias_rad_s",
        neutral=0.0,
        tolerance=0.0035,
    ),
    Named(
        name="body_lift",
        stage="rpm_to_thrust",
        parameter="K_b",
        field="K_b",
        neutral=0.0,
        tolerance=0.25,
        most_below=0.0,
    ),
    Named(
        name="aerodynamic_damping",
        stage="hinge",
        parameter="coefficient",
        field="aero_damping",
        neutral=0.0,
        tolerance=0.5,
        most_below=0.0,
    ),
    Named(
        name="gyro_scale",
        stage="sensor",
        parameter="scale",
        field="gyro_scale",
        neutral=1.0,
        tolerance=0.02,
    ),
    # A plate that reaches under a part of the disc takes a part of the increment.
    Named(
        name="partial_coverage",
        stage="rpm_to_thrust",
        parameter="share",
        field="coverage_share",
        neutral=1.0,
        tolerance=0.1,
        most_above=0.0,
    ),
)

NAMED: dict[str, Named] = {effect.name: effect for effect in _ALL}
