"""Errors that a fit's covariance does not hold: what its model holds fixed, and its own laws."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.error_source import Distribution, ErrorSource
from benchtool.core.parameter import Parameter
from benchtool.core.rig import Rig
from benchtool.fit.problem import Problem
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.conditions import Conditions
from benchtool.physics.effects.effect import Effect
from benchtool.physics.model import Model
from benchtool.physics.tolerances import default_tolerances

READING = ("sensor", "plate")  # between bench and reading: their effects are in every budget
LAW = "law of "  # begins the name of what an effect's own law leaves open: no better bench mends it


def fixed_parameter_sources(
    model: Model, conditions: Conditions, reference: Conditions | None = None
) -> tuple[ErrorSource, ...]:
    """Return the errors of the observations (m,) by what a fitted model holds fixed.

    A parameter counts with its normal prior, else, of an effect between bench and reading, within
    its tolerance, uniformly (GUM, 4.3.7). An effect of the thrust counts with its `law_error`.

    Args:
        model: at its fitted values, the fitted parameters free.
        conditions: of the m points.
        reference: (m,) what each point was divided by, for a ratio.
    """
    whole = _with_readings(model)
    values, places = whole.parameters.values_array(), {n: k for k, n in enumerate(whole.parameters)}
    owners = {f"{one.name}.{item.name}": one for one in whole.effects for item in one.parameters}

    def predicted(changed: Array) -> Array:
        near: Any = whole.thrust_N(conditions, changed)
        if reference is not None:
            near = near / whole.thrust_N(reference, changed)
        return np.broadcast_to(np.asarray(near, float), (len(conditions),))

    here, found = predicted(values), []
    for name, item in whole.parameters.items():
        sd, distribution, origin = _known(owners.get(name), item, whole.rig)
        if not sd or (name in model.parameters and model.parameters[name].free):
            continue
        moved, step = values.copy(), sd if item.value + sd <= item.upper else -sd
        moved[places[name]] += step
        column = (predicted(moved) - here)[:, None] * (sd / step)
        found.append(
            ErrorSource(
                name=name, kind="B", unit=item.unit, sd=sd, columns=column,
                distribution=distribution, origin=origin,
            )
        )  # fmt: skip
    for effect in whole.effects:
        if effect.subsystem == "rpm_to_thrust":
            neutral = values.copy()
            for name in (f"{effect.name}.{item.name}" for item in effect.parameters):
                absent = whole.parameters[name].neutral
                neutral[places[name]] = values[places[name]] if absent is None else absent
            column = effect.law_error * (here - predicted(neutral))[:, None]
            found.append(
                ErrorSource(
                    name=f"{LAW}{effect.name}", kind="B", unit="1", sd=effect.law_error,
                    columns=column, origin="assumed by benchtool: no bench follows a law exactly",
                )
            )  # fmt: skip
    return tuple(one for one in found if np.abs(one.columns).max() > 0.0)


def misfit(problem: Problem, sigma: Array, chi2_per_dof: float) -> ErrorSource:
    """Return what scales the points' stated errors (m,) to the scatter that a model leaves."""
    columns = np.diag(sqrt(chi2_per_dof - 1.0) * sigma)
    return ErrorSource(
        name="misfit", kind="A", unit="N" if problem.basis == "joint" else "1",
        sd=float(np.linalg.norm(columns)) / sqrt(len(sigma)), columns=columns,
        distribution="student_t", dof=float(problem.dof),
        origin=f"stated errors scaled by {sqrt(chi2_per_dof):.3g}, the root of chi2/dof",
    )  # fmt: skip


def _with_readings(model: Model) -> Model:
    """Return the model with every effect between bench and reading, and nothing left out.

    A model leaves out what is neutral and fixed, so that everything is free in it.
    """
    present = {effect.name for effect in model.effects}
    for effect in EFFECTS.values():
        acts = effect.benches | effect.adjusted_on
        if effect.name not in present and effect.subsystem in READING and "sweep" in acts:
            values = effect.rig_values(model.rig) if effect.rig_values else {}
            model = model.with_effect(effect, **values)
    return model.with_free(*model.parameters)


def _known(effect: Effect | None, item: Parameter, rig: Rig) -> tuple[float, Distribution, str]:
    """Return how well a fixed parameter is known, and who says so; 0 where nobody does."""
    if item.prior.kind == "normal":
        return item.prior.sd, "normal", item.prior.source or "prior of the model"
    if effect is None or effect.subsystem not in READING:
        return 0.0, "normal", ""
    usual = default_tolerances(effect, rig, "sweep").get(item.name)
    within = usual if item.tolerance is None else item.tolerance
    who = "assumed by benchtool" if within == usual else "stated by the model"
    return (within or 0.0) / sqrt(3.0), "uniform", f"{who}: {item.value:g} ± {within or 0.0:g}"
