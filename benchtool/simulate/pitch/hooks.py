"""The hooks of a set of effects, joined into what a pitch bench's loop calls."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from benchtool.physics.disc_thrust import disc_thrust, owned
from benchtool.physics.effects.effect import Effect, Flow
from benchtool.physics.expression import expression, replaced
from benchtool.physics.fold import chained, summed


class LoopHooks(NamedTuple):
    """Hold the joined functions of a set of effects over so many discs.

    Attributes:
        bare: a Flow of given heights and coverages, without images.
        with_images, factors, speeds: see `DiscThrust`.
        with_thrust: with_thrust(flow, rate, k, factor) -> the Flow with thrusts, at another rate.
        torque, dry_friction, dry_width: f(i, flow, p), of the hinge, summed over effects.
        gyro: gyro(i, reading, flow, p) -> the gyro's reading, changed by effects.
    """

    bare: Any
    with_images: Any
    factors: Any
    speeds: Any
    with_thrust: Any
    torque: Any
    dry_friction: Any
    dry_width: Any
    gyro: Any


def joined_hooks(
    effects: tuple[Effect, ...], n_discs: int, rule: str, n_arms: int
) -> Callable[[], LoopHooks]:
    """Return a function that gives the hooks of effects, joined for so many discs.

    A compiled loop knows a function by its name, and cannot be handed a tuple of them: it calls
    this one.
    """
    zeros, ones = (0.0,) * n_discs, (1.0,) * n_discs
    thrust = disc_thrust(effects, n_discs, rule, n_arms, clamped=True)

    @expression
    def bare(
        radius_m: Any,
        x_m: Any,
        y_m: Any,
        height: Any,
        coverage: Any,
        speed: Any,
        time_s: Any,
        pitch: Any,
        rate: Any,
        cosine: Any,
        weight_N: Any,
    ) -> Flow:
        return Flow(
            radius_m, x_m, y_m, height, coverage, ones, speed, zeros, zeros, 0.0, 0.0, 0.0, time_s,
            pitch, rate, cosine, weight_N, zeros, 0.0, 0.0,
        )  # fmt: skip

    @expression
    def with_thrust(flow: Any, rate: Any, k: Any, factor: Any) -> Flow:
        speed, thrusts = flow.speed_rad_s, factor
        for i in range(n_discs):
            thrusts = replaced(thrusts, i, k * speed[i] * speed[i] * factor[i])
        return Flow(
            flow.radius_m, flow.position_x_m, flow.position_y_m, flow.height_m, flow.coverage,
            flow.active, flow.speed_rad_s, flow.neighbour_images, flow.body_images,
            flow.body_weight, 0.0, 0.0, flow.time_s, flow.pitch_rad, rate, flow.cos_pitch,
            flow.weight_N, thrusts, 0.0, 0.0,
        )  # fmt: skip

    with_images, factors, speeds = thrust.with_images, thrust.factors, thrust.speeds
    torque, dry_friction, dry_width = (
        summed(owned(effects, hook)) for hook in ("torque", "dry_friction", "dry_width")
    )
    gyro = chained(owned(effects, "gyro_reading"))
    return expression(
        lambda: LoopHooks(
            bare, with_images, factors, speeds, with_thrust, torque, dry_friction, dry_width, gyro
        )
    )
