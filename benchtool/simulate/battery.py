"""A battery pack: open-circuit voltage that falls with charge, and an internal resistance."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

COULOMB_PER_AH = 3600.0
"""One ampere-hour in coulomb."""


@dataclass(frozen=True, slots=True)
class Battery:
    """Describe a pack: full voltage V, fall V/Ah, resistance ohm; zeros are exactly absent."""

    full_V: float
    drop_V_per_Ah: float = 0.0
    resistance_ohm: float = 0.0

    def open_circuit_V(self, drawn_C: float) -> float:
        """Return the voltage without load after `drawn_C` coulomb."""
        return max(self.full_V - self.drop_V_per_Ah * drawn_C / COULOMB_PER_AH, 0.1)

    def loaded_V(self, drawn_C: float, power_W: float) -> float:
        """Return the voltage at the terminals while `power_W` is drawn.

        Solves V = V_oc - r P / V. More power than the pack can give, V_oc^2 / 4r, leaves it at
        half its open-circuit voltage, where that power is reached.
        """
        open_V = self.open_circuit_V(drawn_C)
        inside = 0.25 * open_V * open_V - self.resistance_ohm * power_W
        return 0.5 * open_V + sqrt(max(inside, 0.0))
