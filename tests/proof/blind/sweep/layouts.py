"""What stands on the bench: one rotor, or a quadrotor; the numbers that its owner knows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
LayoutName = Literal["single", "quad"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """Hold the data sheet of a bench."""

    name: LayoutName  # of the layout
    rig: str  # name of the rig that a model file refers to
    places_m: tuple[tuple[float, float], ...]  # rotor axes (x, y), x forward
    mass_kg: float  # of the vehicle
    radius_m: float = 0.12  # of a rotor
    k_N_s2: float = 1.035e-5  # thrust over squared speed of one rotor
    drag_Nm_s2: float = 1.6e-7  # torque over squared speed of one rotor
    pwm_start_us: float = 1050.0  # pulse at which the speed line crosses zero
    gain_rad_s_us: float = 1.05  # slope of speed over pulse at nominal voltage
    nominal_V: float = 11.1  # voltage at which that slope holds
    efficiency: float = 0.75  # mechanical over electrical power
    plate_m: float = 1.2  # side of the square plate
    park_m: float = 1.4  # distance of the parked plate
    se_N: float = 0.0015  # standard error of one visit's mean thrust at hover
    full_scale_N: float = 20.0  # rating of the load cell

    @property
    def rotors(self) -> int:
        """How many rotors there are."""
        return len(self.places_m)

    @property
    def x_m(self) -> Array:
        """Return the rotors' x (n,): m."""
        return np.array([x for x, _ in self.places_m])

    @property
    def y_m(self) -> Array:
        """Return the rotors' y (n,): m."""
        return np.array([y for _, y in self.places_m])

    @property
    def hover_N(self) -> float:
        """Thrust that carries the vehicle."""
        return 9.81 * self.mass_kg


ARM_M = 0.225

SINGLE = Layout(name="single", rig="pquad_single", places_m=((0.0, 0.0),), mass_kg=0.35)
QUAD = Layout(
    name="quad",
    rig="pquad",
    places_m=((ARM_M, 0.0), (0.0, ARM_M), (-ARM_M, 0.0), (0.0, -ARM_M)),
    mass_kg=1.4,
    se_N=0.005,
    full_scale_N=50.0,
)

LAYOUTS: dict[LayoutName, Layout] = {"single": SINGLE, "quad": QUAD}
