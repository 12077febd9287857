"""Friction with a memory: bristles that bend, hold more at rest, and slip (LuGre).

Canudas de Wit, Olsson, Astrom and Lischinsky 1995, IEEE Trans. Automatic Control 40: the bend z
follows dz/dt = v - |v| z / z_s(v), and the torque is stiffness times z plus damping times dz/dt.
Friction then lags behind the rate, so that it is another one at speeding up than at slowing down.
"""

from __future__ import annotations

import math

from tests.blind.pitch.plant import Plant

DAMPING_SHARE = 1.0
"""Bristle damping over the critical damping of beam on bristles; a usual choice."""


class Bristle:
    """Carry the bend of the bristles through time."""

    def __init__(self, plant: Plant) -> None:
        self._coulomb = plant.bristle_coulomb_Nm
        self._excess = plant.bristle_static_Nm - plant.bristle_coulomb_Nm
        self._rate = plant.bristle_rate_rad_s
        self._stiffness = plant.bristle_static_Nm / plant.bristle_angle_rad
        self._damping = DAMPING_SHARE * 2.0 * math.sqrt(self._stiffness * plant.inertia_kgm2)
        self.bend_rad = 0.0

    def torque(self, rate_rad_s: float, dt_s: float) -> float:
        """Bend for one step at this rate; return the torque on the beam: N m.

        The bend's own equation is linear at a held rate and is solved exactly, so that fast
        slipping cannot make it unstable.
        """
        ratio = rate_rad_s / self._rate
        holds = self._coulomb + self._excess * math.exp(-ratio * ratio)
        settled = holds / self._stiffness
        speed = abs(rate_rad_s)
        before = self.bend_rad
        if speed * dt_s < 1e-9 * settled:
            self.bend_rad = before + rate_rad_s * dt_s
        else:
            goal = math.copysign(settled, rate_rad_s)
            self.bend_rad = goal + (before - goal) * math.exp(-speed * dt_s / settled)
        bending = (self.bend_rad - before) / dt_s
        # Damping of a slipping bristle fades, as is usual, so that it adds nothing in motion.
        damping = self._damping * math.exp(-ratio * ratio)
        return -(self._stiffness * self.bend_rad + damping * bending)
