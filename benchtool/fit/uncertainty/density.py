"""Air density of a fit's data; k is also reported at 1.225 kg/m3."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchtool.core.air import STANDARD_DENSITY_KG_M3, Air, relative_density_sd
from benchtool.core.error_source import ErrorSource
from benchtool.data.run.read import is_run
from benchtool.data.run.run_metadata import read_metadata
from benchtool.physics.effects.effect import Derived

STANDARD_K = "k_standard_air"  # k at 1.225 kg/m3, as a quantity of a fit


@dataclass(frozen=True, slots=True, kw_only=True)
class Density:
    """Air density, its standard uncertainty (kg/m3), and its origin."""

    kg_m3: float
    sd: float
    origin: str

    @property
    def standard_k(self) -> Derived:
        """The thrust coefficient at 1.225 kg/m3."""
        factor = STANDARD_DENSITY_KG_M3 / self.kg_m3
        return Derived(STANDARD_K, "N/(rad/s)2", lambda values: factor * values["k"])

    def source(self, standard_k: float) -> tuple[ErrorSource, str]:
        """Return the error source of the standard k due to density, and the quantity's name."""
        source = ErrorSource(
            name="air density", kind="B", unit="kg/m3", sd=self.sd, origin=self.origin,
            columns=np.array([[-standard_k * self.sd / self.kg_m3]]),
        )  # fmt: skip
        return source, STANDARD_K


def air_density(air: Air, paths: Sequence[str]) -> Density | None:
    """Return the density from user input, else from the runs; None if a run lacks it.

    The mean of several runs; the uncertainty includes their scatter.
    """
    user_air = air.facts()
    if user_air["measured"]:
        return _density([user_air], "stated")
    facts: list[dict[str, Any]] = [
        read_metadata(Path(path)).get("air") or {} for path in paths if is_run(path)
    ]
    if len(facts) < len(paths) or not all(air_facts.get("measured") for air_facts in facts):
        return None
    return _density(facts, "measured by the operator")


def _density(facts: Sequence[dict[str, Any]], origin: str) -> Density:
    densities = np.array([entry["density_kg_m3"] for entry in facts])
    relative_sd = max(
        relative_density_sd(entry["temperature_degC"], entry["pressure_Pa"], entry["humidity"])
        for entry in facts
    )
    mean = float(densities.mean())
    first = facts[0]
    return Density(
        kg_m3=mean,
        sd=float(np.hypot(relative_sd * mean, densities.std())),
        origin=f"{origin}: {first['temperature_degC']:g} degC, "
        f"{0.01 * first['pressure_Pa']:g} hPa, {100.0 * first['humidity']:.0f} %; "
        "assumed ± 1 degC, 2 hPa, 20 %",
    )
