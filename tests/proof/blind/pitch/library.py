"""The effects that can be hidden one by one or in pairs: parameter, neutral value, tolerance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tests.proof.blind.families import Stage, Strength, drawn_size
from tests.proof.blind.pitch.plant import Plant
from tests.proof.blind.pitch.sheet import SHEET


@dataclass(frozen=True, slots=True)
class Named:
    """Describe one effect that has a name."""

    name: str
    stage: Stage  # where between pulse and reading it acts
    parameter: str  # of the effect, with its unit in the name where it has one
    field: str  # of the plant that holds it
    neutral: float  # value at which the effect is absent
    tolerance: float  # departure that the bench's owner does not mind
    most_below: float = 8.0  # greatest size below neutral, in tolerances; 0: physics allows none
    most_above: float = 8.0  # greatest size above neutral

    def hide(self, rng: np.random.Generator, strength: Strength) -> Hidden:
        """Draw a size and a side."""
        size = drawn_size(rng, strength, self.most_below, self.most_above)
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
    Named("coulomb_friction", "hinge", "torque_Nm", "friction_Nm", 0.0, 0.002, most_below=0.0),
    Named("viscous_friction", "hinge", "damping_Nms", "damping_Nms", 0.0, 0.004, most_below=0.0),
    Named("hinge_spring", "hinge", "stiffness_Nm_per_rad", "stiffness_Nm_per_rad", 0.0, 0.02),
    Named("cog_offset", "hinge", "x_m", "cog_x_m", 0.0, 0.0005),
    Named("motor_lag", "pwm_to_rpm", "tau_s", "tau_s", SHEET.tau_m, 0.002),
    Named("transport_delay", "pwm_to_rpm", "delay_s", "delay_s", 0.0, 0.002, most_below=0.0),
    Named("rotor_asymmetry", "rpm_to_thrust", "ratio", "thrust_ratio", 1.0, 0.015),
    # The plate is never read so far off that the covered rotor would hit it.
    Named("plate_offset", "plate", "dz_m", "plate_dz_m", 0.0, 0.003, most_below=5.0),
    Named("battery_sag", "pwm_to_rpm", "rate_per_s", "sag_per_s", 0.0, 0.0005, most_below=0.0),
    Named("gyro_bias", "sensor", "bias_rad_s", "gyro_bias_rad_s", 0.0, 0.0035),
    Named("body_lift", "rpm_to_thrust", "K_b", "K_b", 0.0, 0.25, most_below=0.0),
    Named("aerodynamic_damping", "hinge", "coefficient", "aero_damping", 0.0, 0.5, most_below=0.0),
    Named("gyro_scale", "sensor", "scale", "gyro_scale", 1.0, 0.02),
    # A plate that reaches under a part of the disc takes a part of the increment.
    Named("partial_coverage", "rpm_to_thrust", "share", "coverage_share", 1.0, 0.1, most_above=0.0),
)

NAMED: dict[str, Named] = {effect.name: effect for effect in _ALL}
