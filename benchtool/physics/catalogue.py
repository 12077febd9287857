"""Every effect by name: the directory is the list of what the tool knows."""

from __future__ import annotations

from benchtool.core.errors import UnknownChoice
from benchtool.physics.effects import (
    aerodynamic_damping,
    battery_sag,
    body_lift,
    cable,
    cog_offset,
    coulomb_friction,
    ground_shape,
    gyro_bias,
    gyro_scale,
    hinge_spring,
    load_cell_drift,
    load_cell_hysteresis,
    motor_lag,
    neighbour_images,
    partial_coverage,
    plate_offset,
    plate_side,
    plate_tilt,
    rotor_asymmetry,
    speed_map,
    stribeck,
    tare_offset,
    thrust_exponent,
    transport_delay,
    viscous_friction,
    wake_torque,
    wall_blockage,
)
from benchtool.physics.effects.effect import BenchKind, Effect

EFFECTS: dict[str, Effect] = {
    module.EFFECT.name: module.EFFECT
    for module in (
        transport_delay,
        motor_lag,
        speed_map,
        battery_sag,
        plate_offset,
        plate_tilt,
        plate_side,
        ground_shape,
        neighbour_images,
        body_lift,
        partial_coverage,
        thrust_exponent,
        wall_blockage,
        rotor_asymmetry,
        coulomb_friction,
        stribeck,
        viscous_friction,
        aerodynamic_damping,
        hinge_spring,
        cable,
        cog_offset,
        wake_torque,
        gyro_bias,
        gyro_scale,
        tare_offset,
        load_cell_drift,
        load_cell_hysteresis,
    )
}
"""Every effect, in the order of the chain from pulse width to reading."""


def effect_named(name: str) -> Effect:
    """Return the effect of that name, or refuse it with the known ones."""
    try:
        return EFFECTS[name]
    except KeyError:
        raise UnknownChoice("effect", name, EFFECTS) from None


def candidates(bench: BenchKind) -> tuple[Effect, ...]:
    """Return the effects that an explanation may name on that kind of bench, in order."""
    return tuple(effect for effect in EFFECTS.values() if bench in effect.benches)
