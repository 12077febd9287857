"""The air of a fit's data: k goes with its density, so that it is given at 1.225 kg/m3 as well."""

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
    """Hold the air's density, its standard uncertainty (kg/m3), and who knows it."""

    kg_m3: float
    sd: float
    origin: str

    @property
    def standard_k(self) -> Derived:
        """The thrust coefficient at 1.225 kg/m3."""
        factor = STANDARD_DENSITY_KG_M3 / self.kg_m3
        return Derived(STANDARD_K, "N/(rad/s)2", lambda values: factor * values["k"])

    def source(self, standard_k: float) -> tuple[ErrorSource, str]:
        """Return what the density contributes to it, and its name."""
        source = ErrorSource(
            name="air density", kind="B", unit="kg/m3", sd=self.sd, origin=self.origin,
            columns=np.array([[-standard_k * self.sd / self.kg_m3]]),
        )  # fmt: skip
        return source, STANDARD_K


def air_density(air: Air, paths: Sequence[str]) -> Density | None:
    """Return the density of what was stated, else of what every run measured; None without.

    Of several runs it is the mean, and its uncertainty holds how far they are apart.
    """
    stated = air.facts()
    if stated["measured"]:
        return _density([stated], "stated")
    facts: list[dict[str, Any]] = [
        read_metadata(Path(path)).get("air") or {} for path in paths if is_run(path)
    ]
    if len(facts) < len(paths) or not all(one.get("measured") for one in facts):
        return None
    return _density(facts, "measured by the operator")


def _density(facts: Sequence[dict[str, Any]], who: str) -> Density:
    densities = np.array([one["density_kg_m3"] for one in facts])
    own = max(
        relative_density_sd(one["temperature_degC"], one["pressure_Pa"], one["humidity"])
        for one in facts
    )
    mean = float(densities.mean())
    first = facts[0]
    return Density(
        kg_m3=mean,
        sd=float(np.hypot(own * mean, densities.std())),
        origin=f"{who}: {first['temperature_degC']:g} degC, {0.01 * first['pressure_Pa']:g} hPa, "
        f"{100.0 * first['humidity']:.0f} %; assumed ± 1 degC, 2 hPa, 20 %",
    )
