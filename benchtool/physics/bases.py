"""T_IGE/T_OGE of a model with speed, pulse or power held equal between a visit and its reference.

Where blades answer to inflow (`effects.blade_inflow`) the three differ: the rotor near a plate has
another torque, so that it turns at another speed under the same pulse and draws another power.
Without it they are one ratio, as the paper takes them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.physics.conditions import Conditions
from benchtool.physics.effects.blade_inflow import EFFECT as BLADE_INFLOW
from benchtool.physics.effects.effect import Flow, Quantity
from benchtool.physics.model import Model
from benchtool.physics.motor import electrical_power_W, speed_under_pulse, torque_at_pulse_Nm

POWER_STEPS = 16  # to the speed at equal power, w^2.7 to w^3.3: each leaves a tenth of the error


BLADES_OF_RIG = "[blade] of the rig"  # source of numbers that follow a rig, whichever it is


def with_blades_of_rig(model: Model) -> Model:
    """Return the model with the rig's blades, where it has none itself and the rig some.

    A law that is about equal thrust commands, nearly equal speeds, is left as it stands.
    """
    laws = [effect.distance_law for effect in model.effects]
    commanded = any(law and law.basis == "equal commanded thrust" for law in laws)
    has_some = any(effect.hooks.response is not None for effect in model.effects)
    return model if commanded or has_some or model.rig.blade is None else with_blades(model)


def with_blades(model: Model) -> Model:
    """Return the model with `blade_inflow`, its numbers the rig's where that states its blades."""
    assert BLADE_INFLOW.rig_values is not None
    model = model.with_effect(BLADE_INFLOW)
    parameters = model.parameters
    for key, value in BLADE_INFLOW.rig_values(model.rig).items():
        full = f"{BLADE_INFLOW.name}.{key}"
        stated = replace(parameters[full], value=value, source=BLADES_OF_RIG)
        parameters = parameters.with_replaced(full, stated)
    return model.with_values(parameters)


def blade_tables(tables: Mapping[str, Any], rig: Rig) -> dict[str, Any]:
    """Return a model file's tables of `blade_inflow` without numbers that follow the rig.

    Raises:
        InputError: the numbers are those of a rig's blades, and this one states none.
    """
    follow = [
        key
        for key, table in tables.items()
        if isinstance(table, Mapping)
        and table.get("source") == BLADES_OF_RIG
        and not table.get("free", False)
    ]
    if follow and rig.blade is None:
        raise InputError(
            f"{BLADE_INFLOW.name}.{follow[0]} is that of another rig's blades, and rig "
            f"{rig.name!r} states none; add its [blade], or take [effects.{BLADE_INFLOW.name}] out"
        )
    return {key: table for key, table in tables.items() if key not in follow}


def require_motor(model: Model, basis: str) -> None:
    """Refuse a ratio at equal pulse of blades whose motor nobody has described."""
    if basis == "equal_pwm" and model.is_torque_driven and model.rig.motor is None:
        raise InputError(
            f"at equal pulse a rotor near the plate turns at another speed, and rig "
            f"{model.rig.name!r} has blades but no [motor] that says by how much; add the table "
            f"(governed = true where the ESC holds the speed), or choose --basis equal_rpm2"
        )


def thrust_ratio(model: Model, basis: str, near: Flow, far: Flow, values: Any) -> Any:
    """Return the reading of the whole vehicle's thrust near over far (..., m).

    Args:
        basis: "equal_rpm2", "equal_pwm" or "equal_power": by `electrical_power_W`.
    """
    if basis != "equal_rpm2" and model.is_torque_driven:
        drags = [model.drag_factors(flow, values) for flow in (near, far)]
        moved = _at_equal_pulse if basis == "equal_pwm" else _at_equal_power
        far = far._replace(speed_rad_s=moved(model, near, *drags))
    return model.reading_N(near, values) / model.reading_N(far, values)


def factor_at(model: Model, basis: str, conditions: Conditions, values: Any = None) -> Any:
    """Return T_IGE/T_OGE of the whole vehicle (..., m) at a basis, over no plate at all."""
    values = model.parameters.values_array() if values is None else values
    near, far = conditions, conditions.out_of_ground_effect()
    return thrust_ratio(model, basis, model.flow(near, values), model.flow(far, values), values)


def speed_factors(model: Model, flow: Flow, values: Any) -> list[Array]:
    """Return the speed of each disc over that under the same pulse far from any surface (..., m).

    A rotor that stands has 1.
    """
    free = [1.0] * len(flow.height_m)
    far = _at_equal_pulse(model, flow, model.drag_factors(flow, values), free)
    return [
        np.divide(here, away, out=np.ones_like(away), where=away > 0.0)
        for here, away in zip(flow.speed_rad_s, far, strict=True)
    ]


def _at_equal_pulse(model: Model, near: Flow, drag: Any, far_drag: Any) -> list[Quantity]:
    """Return the speed of each disc at the reference, where pulses are those of the visit."""
    slope, c = model.motor_slope_Nm_s, model.rig.propulsion.drag_coefficient_Nm_s2
    if slope is None:
        return list(near.speed_rad_s)
    out = []
    for w, q, far_q, n in zip(
        near.speed_rad_s, drag, far_drag, model.rig.rotors_on_disc, strict=True
    ):
        # n equal rotors on a disc turn at w / sqrt(n)
        held = torque_at_pulse_Nm(w / np.sqrt(n), c * q, slope)
        out.append(np.sqrt(n) * speed_under_pulse(held, c * far_q, slope))
    return out


def _at_equal_power(model: Model, near: Flow, drag: Any, far_drag: Any) -> list[Quantity]:
    """Return the speeds at the reference, one factor on all, where the power is the visit's."""
    wanted, scale = _power_W(model, near, drag), 1.0
    for _ in range(POWER_STEPS):
        drawn = _power_W(model, near, far_drag, scale)
        scale = scale * (wanted / drawn) ** (1.0 / 3.0)
    return [scale * w for w in near.speed_rad_s]


def _power_W(model: Model, flow: Flow, drag: Any, scale: Quantity = 1.0) -> Quantity:
    """Return the electrical power of all motors, speeds times `scale`: W."""
    rig, total = model.rig, 0.0
    for w, q, n, on in zip(flow.speed_rad_s, drag, rig.rotors_on_disc, flow.active, strict=True):
        total = total + n * on * electrical_power_W(
            rig.propulsion, rig.motor, scale * w / np.sqrt(n), q
        )
    return total


def thrust_per_power_N_W(model: Model, conditions: Conditions, values: Any = None) -> Any:
    """Return the thrust over the electrical power of the motors (..., m): N/W, sensors left out.

    Args:
        model: whose rig describes blades, motors and c; without blades torque is the same
            everywhere, without a motor power is the shafts' over the stated efficiency.
        values: all parameters; the model's own when left out.
    """
    values = model.parameters.values_array() if values is None else values
    flow, k = model.flow(conditions, values), values[list(model.parameters).index("k")]
    power_W = _power_W(model, flow, model.drag_factors(flow, values))
    return k * model.squared_speed(flow, values) / power_W
