"""T_IGE/T_OGE of a model at equal speed, equal pulse width or equal power.

With blade data (`effects.blade_inflow`) the three differ: near a plate the torque changes, and with
it the speed at a given pulse width and the power. Without blade data they are equal, as in the
paper.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.physics.conditions import Conditions
from benchtool.physics.effects.blade_inflow import EFFECT as BLADE_INFLOW
from benchtool.physics.effects.effect import Flow, Quantity
from benchtool.physics.model import Model
from benchtool.physics.rotor import electrical_power_W, speed_under_pulse, torque_at_pulse_Nm

POWER_STEPS = 16  # iterations for equal power, w^2.7 to w^3.3; each leaves a tenth of the error

BLADES_OF_RIG = "[blade] of the rig"  # source of parameters that are taken from the current rig


def with_rig_blades(model: Model) -> Model:
    """Return the model with the rig's blades, if it has none itself and the rig defines some.

    Laws at equal thrust command (nearly equal speed) are left unchanged.
    """
    laws = [effect.distance_law for effect in model.effects]
    is_commanded = any(law and law.basis == "equal commanded thrust" for law in laws)
    has_blades = any(effect.hooks.response is not None for effect in model.effects)
    return model if is_commanded or has_blades or model.rig.blade is None else with_blades(model)


def with_blades(model: Model) -> Model:
    """Return the model with `blade_inflow`, with the blade values of the rig if it has them."""
    assert BLADE_INFLOW.rig_values is not None
    model = model.with_effect(BLADE_INFLOW)
    parameters = model.parameters
    for key, value in BLADE_INFLOW.rig_values(model.rig).items():
        name = f"{BLADE_INFLOW.name}.{key}"
        parameter = replace(parameters[name], value=value, source=BLADES_OF_RIG)
        parameters = parameters.with_replaced(name, parameter)
    return model.with_values(parameters)


def blade_tables(tables: Mapping[str, Any], rig: Rig) -> dict[str, Any]:
    """Return a model file's tables of `blade_inflow` without parameters taken from the rig."""
    rig_keys = [
        key
        for key, table in tables.items()
        if isinstance(table, Mapping)
        and table.get("source") == BLADES_OF_RIG
        and not table.get("free", False)
    ]
    if rig_keys and rig.blade is None:
        raise InputError(
            f"{BLADE_INFLOW.name}.{rig_keys[0]} is from the blades of another rig, and rig "
            f"{rig.name!r} has no [blade]; add it or remove [effects.{BLADE_INFLOW.name}]"
        )
    return {key: table for key, table in tables.items() if key not in rig_keys}


def require_motor(model: Model, basis: str) -> None:
    """Raise if the rig has no motor data, needed for ratios at equal pulse width."""
    if basis == "equal_pwm" and model.is_torque_driven and model.rig.motor is None:
        raise InputError(
            f"rig {model.rig.name!r} has [blade] but no [motor] table, needed for the speed change "
            f"at equal pulse width near the plate; add it (governed = true if the ESC controls the "
            f"speed) or use --basis equal_rpm2"
        )


def thrust_ratio(model: Model, basis: str, near: Flow, far: Flow, values: Any) -> Any:
    """Return the thrust reading of the vehicle near the plate over that at the reference (..., m).

    Args:
        basis: "equal_rpm2", "equal_pwm" or "equal_power" (`electrical_power_W`).
    """
    if basis != "equal_rpm2" and model.is_torque_driven:
        drags = [model.drag_factors(flow, values) for flow in (near, far)]
        reference_speeds = (
            _speeds_at_equal_pulse if basis == "equal_pwm" else _speeds_at_equal_power
        )
        far = far._replace(speed_rad_s=reference_speeds(model, near, *drags))
    return model.reading_N(near, values) / model.reading_N(far, values)


def ground_effect_ratio(
    model: Model, basis: str, conditions: Conditions, values: Any = None
) -> Any:
    """Return T_IGE/T_OGE of the vehicle (..., m) on a basis; the reference has no plate."""
    values = model.parameters.values_array() if values is None else values
    near, far = conditions, conditions.out_of_ground_effect()
    return thrust_ratio(model, basis, model.flow(near, values), model.flow(far, values), values)


def speed_factors(model: Model, flow: Flow, values: Any) -> list[Array]:
    """Return the speed of each disc over that out of ground effect at equal pulse width (..., m).

    The ratio is 1 for rotors at standstill.
    """
    free = [1.0] * len(flow.height_m)
    far = _speeds_at_equal_pulse(model, flow, model.drag_factors(flow, values), free)
    return [
        np.divide(speed, far_speed, out=np.ones_like(far_speed), where=far_speed > 0.0)
        for speed, far_speed in zip(flow.speed_rad_s, far, strict=True)
    ]


def _speeds_at_equal_pulse(model: Model, near: Flow, drag: Any, far_drag: Any) -> list[Quantity]:
    """Return the speed of each disc at the reference with the pulse widths of the point."""
    slope, c = model.motor_slope_Nm_s, model.rig.propulsion.drag_coefficient_Nm_s2
    if slope is None:
        return list(near.speed_rad_s)
    speeds = []
    for w, q, far_q, n in zip(
        near.speed_rad_s, drag, far_drag, model.rig.rotors_on_disc, strict=True
    ):
        # n equal rotors on a disc have the speed w / sqrt(n)
        torque_Nm = torque_at_pulse_Nm(w / np.sqrt(n), c * q, slope)
        speeds.append(np.sqrt(n) * speed_under_pulse(torque_Nm, c * far_q, slope))
    return speeds


def _speeds_at_equal_power(model: Model, near: Flow, drag: Any, far_drag: Any) -> list[Quantity]:
    """Return the speeds at the reference with the power of the point; one factor for all discs."""
    target_W, scale = _power_W(model, near, drag), 1.0
    for _ in range(POWER_STEPS):
        power_W = _power_W(model, near, far_drag, scale)
        scale = scale * (target_W / power_W) ** (1.0 / 3.0)
    return [scale * w for w in near.speed_rad_s]


def _power_W(model: Model, flow: Flow, drag: Any, scale: Quantity = 1.0) -> Quantity:
    """Return the electrical power of all motors at `scale` times the speeds: W."""
    rig, total = model.rig, 0.0
    discs = zip(flow.speed_rad_s, drag, rig.rotors_on_disc, flow.active, strict=True)
    for w, q, n, active in discs:
        total = total + n * active * electrical_power_W(
            rig.propulsion, rig.motor, scale * w / np.sqrt(n), q
        )
    return total


def thrust_per_power_N_W(model: Model, conditions: Conditions, values: Any = None) -> Any:
    """Return the thrust, without sensor effects, over the electrical power (..., m): N/W.

    Args:
        model: with blades, motors and c in its rig; without blades the torque is independent of
            the plate, without a motor the power is the shaft power over the efficiency.
        values: all parameters; default: those of the model.
    """
    values = model.parameters.values_array() if values is None else values
    flow, k = model.flow(conditions, values), values[list(model.parameters).index("k")]
    power_W = _power_W(model, flow, model.drag_factors(flow, values))
    return k * model.squared_speed(flow, values) / power_W
