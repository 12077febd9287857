"""Estimation problems of a ground-effect model in steady conditions, and of a function."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from benchtool.core.parameter import Parameter, Parameters
from benchtool.core.units import Array
from benchtool.fit.problem import NOISE_SCALE, IntArray, Predict, Problem
from benchtool.fit.recipe import Basis
from benchtool.physics.bases import require_motor, thrust_ratio
from benchtool.physics.conditions import OUT_OF_GROUND_EFFECT_M, Conditions
from benchtool.physics.model import Model
from benchtool.physics.precomputed import PrecomputedModel
from benchtool.physics.tolerances import find_trend_effects, with_tolerances

SAME_DISTANCE_M = 1e-3  # plate distances that round to the same multiple are one setting
SAME_LEVEL = 0.02  # speed resolution of a throttle level, relative to the fastest: voltage sags


def problem_from_model(
    model: Model,
    conditions: Conditions,
    observed: Array,
    standard_error: Array | None = None,
    *,
    basis: Basis = "joint",
    reference: Conditions | None = None,
    **fields: Any,
) -> Problem:
    """Return the problem of a model's free parameters and points in steady state.

    In a fit of ratios k is fixed (fact `held`): it only relates a tare error or drift to the
    thrust.

    Args:
        conditions: conditions of m points.
        observed: (m,) thrust of the whole vehicle in N for basis "joint", else T_IGE/T_OGE.
        standard_error: (m,) of the observations; None means equal and unknown.
        reference: (m,) reference conditions of each ratio; None means no plate. A parked plate
            still has a ground effect of some per mille, which would bias R and K_b.
        fields: further fields of the problem; `groups` are by default plate positions.
    """
    facts: dict[str, str | int | float | bool | None] = {"left_out_near": 0}  # key of result.json
    parameters = with_tolerances(model, "sweep")
    if standard_error is None:
        standard_error = np.ones(len(observed))
        # With standard errors of 1 the scale is the error itself.
        scale = replace(parameters["noise.scale"], unit="N" if basis == "joint" else "1")
        parameters = parameters.with_replaced("noise.scale", scale.as_free())
        facts["standard_errors"] = "unknown, taken as equal"
    model = model.with_values(parameters)
    far: Conditions | None = None
    if basis != "joint":
        far = conditions.out_of_ground_effect() if reference is None else reference
        facts["held"] = "k" if model.parameters["k"].free else ""
        model = model.with_fixed("k")
        if basis == "equal_power" and model.is_torque_driven and model.rig.motor is None:
            facts["power"] = "of the shafts: the rig describes no motor"
    z_over_R, speed = model.z_over_R(conditions), conditions.speed_rad_s.max(axis=0)
    step = SAME_LEVEL * float(speed.max()) or 1.0
    columns = {
        "z_over_R": z_over_R,
        "speed_rad_s": np.round(speed / step) * step,
        "time_s": conditions.time_s,
    }
    return function_problem(
        model.name,
        model.parameters,
        _prediction(model, conditions, far, basis),
        observed,
        standard_error,
        basis=basis,
        labels=_labels(conditions, z_over_R),
        covariates=_varying(columns),
        facts=facts,
        missing=partial(find_trend_effects, model, conditions),
        **{"groups": plate_settings(conditions), **fields},
    )


def plate_settings(conditions: Conditions) -> IntArray:
    """Return the number of the plate setting (distance, tilt, coverage) of each point (m,)."""
    table = np.column_stack(
        [
            np.round(conditions.plate_z_m / SAME_DISTANCE_M),
            np.round(conditions.plate_tilt_rad, 3),
            np.round(conditions.coverage, 2).T,
        ]
    )
    return np.unique(table, axis=0, return_inverse=True)[1].reshape(-1).astype(np.intp)


def _varying(columns: Mapping[str, Array]) -> dict[str, Array]:
    """Return the columns that vary; infinite z/R (no plate) is clipped to 10 times the largest."""
    out = {}
    for name, column in columns.items():
        finite = column[column < 1e3] if name == "z_over_R" else column
        if finite.size and np.ptp(finite) > 0.0:
            out[name] = np.minimum(column, 10.0 * finite.max()) if name == "z_over_R" else column
    return out


def _labels(conditions: Conditions, z_over_R: Array) -> tuple[str, ...]:
    speed = conditions.speed_rad_s.max(axis=0)
    return tuple(
        f"point {i + 1} ({f'z/R {z:.3g}' if far < OUT_OF_GROUND_EFFECT_M else 'no plate'}, "
        f"{w:.4g} rad/s)"
        for i, (z, far, w) in enumerate(zip(z_over_R, conditions.plate_z_m, speed, strict=True))
    )


def _prediction(
    model: Model, conditions: Conditions, reference: Conditions | None, basis: Basis
) -> Callable[[Any], Any]:
    """Return the prediction of thrust in N, or of its ratio to a reference, from shape values."""
    require_motor(model, basis)
    merge = basis in {"joint", "equal_rpm2"} or not model.is_torque_driven
    near = PrecomputedModel(model, conditions, merge=merge)
    far = None if reference is None else PrecomputedModel(model, reference, merge=merge)
    template: list[Any] = [parameter.value for parameter in model.parameters.values()]
    positions = [
        position
        for position, (name, parameter) in enumerate(model.parameters.items())
        if parameter.free and not name.startswith("noise.")
    ]

    def predict(values: Any) -> Any:
        full = template.copy()
        for position, value in zip(positions, values, strict=True):
            full[position] = value
        if far is None:
            return near.thrust_N(full)
        return thrust_ratio(model, basis, near.flow(full), far.flow(full), full)

    return predict


def noise_parameter() -> Parameter:
    """Return a free `noise.scale`, a common factor on the standard errors."""
    description = "factor on the stated standard errors"
    return Parameter("scale", "1", 1.0, lower=0.0, free=True, description=description)


def function_problem(
    name: str,
    parameters: Mapping[str, Parameter],
    predict: Predict,
    observed: Array,
    standard_error: Array | None = None,
    **fields: Any,
) -> Problem:
    """Return the problem of a vectorised function, see `Predict`.

    Without standard errors they are equal and unknown: 1 times a free `noise.scale`.
    """
    all_parameters = Parameters(parameters)
    if standard_error is None:
        standard_error = np.ones(len(observed))
        all_parameters = Parameters({**parameters, NOISE_SCALE: noise_parameter()})
    return Problem(
        model=name,
        parameters=all_parameters,
        predict=predict,
        observed=np.asarray(observed, float),
        standard_error=np.asarray(standard_error, float),
        **fields,
    )
