"""Error sources outside of a fit's covariance: fixed parameters, law errors, air density."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np

from benchtool.core.air import STANDARD_DENSITY_KG_M3, Air, relative_density_sd
from benchtool.core.choices import Distribution
from benchtool.core.error_source import ErrorSource
from benchtool.core.parameter import Parameter
from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.data.run.read import is_run
from benchtool.data.run.run_metadata import read_metadata
from benchtool.fit.problem import Problem
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.conditions import Conditions
from benchtool.physics.effects.effect import Derived, Effect
from benchtool.physics.model import Model
from benchtool.physics.tolerances import default_tolerances

READING = ("sensor", "plate")  # subsystems between bench and reading; in every budget
STANDARD_K = "k_standard_air"  # k at 1.225 kg/m3, as a quantity of a fit
LAW = "law of "  # prefix of the source for the error of an effect's law, not of the bench


def fixed_parameter_sources(
    model: Model, conditions: Conditions, reference: Conditions | None = None
) -> tuple[ErrorSource, ...]:
    """Return the errors of the observations (m,) due to the fixed parameters of a fitted model.

    A parameter has its normal prior; without one, a parameter of a reading effect is uniform within
    its tolerance (GUM, 4.3.7). A thrust effect contributes its `law_error`.

    The model is at its fitted values, the fitted parameters free. `reference` are the reference
    conditions (m,) of each ratio.
    """
    full = _with_readings(model)
    values, index = full.parameters.values_array(), {n: k for k, n in enumerate(full.parameters)}
    pairs = [(effect, item) for effect in full.effects for item in effect.parameters]
    effects = {f"{effect.name}.{item.name}": effect for effect, item in pairs}

    def predicted(changed: Array) -> Array:
        thrust: Any = full.thrust_N(conditions, changed)
        if reference is not None:
            thrust = thrust / full.thrust_N(reference, changed)
        return np.broadcast_to(np.asarray(thrust, float), (len(conditions),))

    nominal, sources = predicted(values), []
    for name, item in full.parameters.items():
        sd, distribution, origin = _prior_uncertainty(effects.get(name), item, full.rig)
        if not sd or (name in model.parameters and model.parameters[name].free):
            continue
        shifted, step = values.copy(), sd if item.value + sd <= item.upper else -sd
        shifted[index[name]] += step
        column = (predicted(shifted) - nominal)[:, None] * (sd / step)
        sources.append(
            ErrorSource(
                name=name, kind="B", unit=item.unit, sd=sd, columns=column,
                distribution=distribution, origin=origin,
            )
        )  # fmt: skip
    for effect in full.effects:
        if effect.subsystem == "rpm_to_thrust":
            neutral = values.copy()
            for name in (f"{effect.name}.{item.name}" for item in effect.parameters):
                absent = full.parameters[name].neutral
                neutral[index[name]] = values[index[name]] if absent is None else absent
            column = effect.law_error * (nominal - predicted(neutral))[:, None]
            sources.append(
                ErrorSource(
                    name=f"{LAW}{effect.name}", kind="B", unit="1", sd=effect.law_error,
                    columns=column, origin="assumed by benchtool: no bench follows a law exactly",
                )
            )  # fmt: skip
    return tuple(source for source in sources if np.abs(source.columns).max() > 0.0)


def misfit(problem: Problem, sigma: Array, chi2_per_dof: float) -> ErrorSource:
    """Return the source that adds to the stated errors (m,) up to the scatter of the residuals."""
    columns = np.diag(sqrt(chi2_per_dof - 1.0) * sigma)
    return ErrorSource(
        name="misfit", kind="A", unit="N" if problem.basis == "joint" else "1",
        sd=float(np.linalg.norm(columns)) / sqrt(len(sigma)), columns=columns,
        distribution="student_t", dof=float(problem.dof),
        origin=f"stated errors scaled by {sqrt(chi2_per_dof):.3g}, the root of chi2/dof",
    )  # fmt: skip


def _with_readings(model: Model) -> Model:
    """Return the model with all reading effects and all parameters free.

    Free, because a model skips effects that are neutral and fixed.
    """
    present = {effect.name for effect in model.effects}
    for effect in EFFECTS.values():
        benches = effect.benches | effect.adjusted_on
        if effect.name not in present and effect.subsystem in READING and "sweep" in benches:
            values = effect.rig_values(model.rig) if effect.rig_values else {}
            model = model.with_effect(effect, **values)
    return model.with_free(*model.parameters)


def _prior_uncertainty(
    effect: Effect | None, item: Parameter, rig: Rig
) -> tuple[float, Distribution, str]:
    """Return standard uncertainty, distribution and origin of a fixed parameter; 0 if unknown."""
    if item.prior.kind == "normal":
        return item.prior.sd, "normal", item.prior.source or "prior of the model"
    if effect is None or effect.subsystem not in READING:
        return 0.0, "normal", ""
    default = default_tolerances(effect, rig, "sweep").get(item.name)
    tolerance = default if item.tolerance is None else item.tolerance
    origin = "assumed by benchtool" if tolerance == default else "stated by the model"
    half_width = tolerance or 0.0
    return half_width / sqrt(3.0), "uniform", f"{origin}: {item.value:g} ± {half_width:g}"


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

    def source(self, standard_k: float) -> ErrorSource:
        """Return the error source of the standard k due to density."""
        return ErrorSource(
            name="air density", kind="B", unit="kg/m3", sd=self.sd, origin=self.origin,
            columns=np.array([[-standard_k * self.sd / self.kg_m3]]),
        )  # fmt: skip


def air_density(air: Air, paths: Sequence[str]) -> Density | None:
    """Return the density from user input, else from the runs; None if a run lacks it.

    The mean of several runs; the uncertainty includes their scatter.
    """
    facts: list[dict[str, Any]] = [air.facts()]
    origin = "stated"
    if not facts[0]["measured"]:
        facts = [read_metadata(Path(path)).get("air") or {} for path in paths if is_run(path)]
        origin = "measured by the operator"
        if len(facts) < len(paths) or not all(entry.get("measured") for entry in facts):
            return None
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
