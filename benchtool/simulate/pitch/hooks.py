"""The hooks of a pitch bench's effects, spelled out for a number of discs and of lanes."""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType

from benchtool.physics.effects.effect import Effect
from benchtool.physics.wake_rules import wake_rule
from benchtool.simulate.spelled import Spelling, chained, each, module_of, summed

_TEXT = '''"""Effects of a pitch bench, spelled out: {names}.

{n} discs, {lanes} lanes, wake rule {rule}. Written by benchtool.simulate.pitch.hooks.
"""

import numpy as np

from benchtool.physics.expression import compiled
from benchtool.physics.images import image_velocity, partial_factor, thrust_factor
from benchtool.physics.validity import clamped_height
from benchtool.physics.effects.effect import Flow
from benchtool.simulate.gathered import line, plane, solid
from benchtool.simulate.pitch.kernel import run_ticks
from benchtool.simulate.pitch.shared import Hooks
from benchtool.simulate.pitch.track import track_ticks
from benchtool.simulate.spelled import spelled
{imports}


@spelled
def numbers(w, row, lane, at):
    return {numbers}


@spelled
def of_discs(w, row, lane, at):
    return {of_discs}


@spelled
def places(table):
    return {x}, {y}, {roots}


@spelled
def spans(distances, arms):
    return {matrix}, {centre}


@spelled
def gaps(gap_m, x_m, sine):
    return {gaps}


@spelled
def bare(radius_m, x_m, y_m, height, area, speed, time_s, pitch, rate, cosine, weight):
    return Flow(radius_m, x_m, y_m, height, area, {ones}, speed, {zeros}, {zeros}, 0.0, 0.0,
                0.0, time_s, pitch, rate, cosine, weight, {zeros}, 0.0, 0.0)


@spelled
def blown(flow, distances, arms, p):
    height = {heights}
    area = {areas}
    return Flow(flow.radius_m, flow.position_x_m, flow.position_y_m, height, area, flow.active,
                flow.speed_rad_s, {images}, {bodies}, {weight}(area), 0.0, 0.0,
                flow.time_s, flow.pitch_rad, flow.rate_rad_s, flow.cos_pitch, flow.weight_N,
                {zeros}, 0.0, 0.0)


@spelled
def factors(flow, p):
    return {factors}


@spelled
def loaded(flow, rate, k, factor):
    speed = flow.speed_rad_s
    return Flow(flow.radius_m, flow.position_x_m, flow.position_y_m, flow.height_m, flow.coverage,
                flow.active, speed, flow.neighbour_images, flow.body_images, flow.body_weight,
                0.0, 0.0, flow.time_s, flow.pitch_rad, rate, flow.cos_pitch, flow.weight_N,
                {thrusts}, 0.0, 0.0)


@spelled
def torque(flow, p):
    return {torque}


@spelled
def dry_friction(flow, p):
    return {dry_friction}


@spelled
def dry_width(flow, p):
    return {dry_width}


@spelled
def speeds(flow, p):
    return {speeds}


@spelled
def gyro(reading, flow, p):
    return {gyro}


LANES = {lane_tuple}


@compiled
def run(w, states, sent, past, log, logged, schedule, fresh, table, distances, arms, plan, dt_s):
    run_ticks(w, states, sent, past, log, logged, schedule, fresh, table, distances, arms, plan,
              dt_s, LANES, Hooks(numbers, of_discs, places, spans, gaps, bare, blown,
                                 factors, loaded, torque, dry_friction, dry_width, speeds, gyro))


@compiled
def tick(block, where, plan, number):
    plan[0] = number
    plan[1] = number + 1
    run_ticks(line(block, where, 0), line(block, where, 1).view(np.int64),
              line(block, where, 2), line(block, where, 3), solid(block, where, 4),
              line(block, where, 5).view(np.int64), plane(block, where, 6),
              plane(block, where, 7), plane(block, where, 8), plane(block, where, 9),
              line(block, where, 10), plan, line(block, where, 11)[0], LANES,
              Hooks(numbers, of_discs, places, spans, gaps, bare, blown, factors, loaded,
                    torque, dry_friction, dry_width, speeds, gyro))


@compiled
def track(w, states, sent, log, logged, schedule, seen, gains, table, distances, arms, plan, dt_s,
          before):
    track_ticks(w, states, sent, log, logged, schedule, seen, gains, table, distances, arms, plan,
                dt_s, before, LANES, Hooks(numbers, of_discs, places, spans, gaps, bare,
                                   blown, factors, loaded, torque, dry_friction, dry_width, speeds,
                                   gyro))
'''


def pitch_module(
    effects: Sequence[Effect], n_discs: int, lanes: int, rule: str, arms: int
) -> ModuleType:
    """Return the module whose `run` advances `lanes` benches of `n_discs` discs together.

    Args:
        effects: to spell out.
        n_discs: how many discs a bench has.
        lanes: how many benches.
        rule: wake rule.
        arms: how many images of eq. (4) the body has.
    """
    spelling = Spelling(effects)
    weight = spelling.name_of(wake_rule(rule).weight)
    gyro = chained(spelling, "gyro_reading", "reading", "0, flow")

    def spread(text: str) -> str:
        return "(" + "".join(text.replace(" i, ", f" {i}, ").replace("[i]", f"[{i}]") + ", "
                             for i in range(n_discs)) + ")"  # fmt: skip

    denominators = summed(spelling, "denominator", "i, flow")
    products = [
        f"{spelling.name_of(hook)}({spelling.own(effect)}, i, flow)"
        for effect, hook in spelling.with_hook("factor")
    ]
    base = "partial_factor(thrust_factor({}), flow.coverage[i])"
    total = sum(len(effect.parameters) for effect in effects)
    text = _TEXT.format(
        names=", ".join(effect.name for effect in effects) or "none",
        n=n_discs,
        lanes=lanes,
        rule=rule,
        numbers=each(total, "w[(row + {i}) * at + lane]") if total else "(0.0,)",
        of_discs=each(n_discs, "w[(row + {i}) * at + lane]"),
        x=each(n_discs, "table[{i}, 0]"),
        y=each(n_discs, "table[{i}, 1]"),
        roots=each(n_discs, "table[{i}, 2]"),
        matrix="("
        + "".join(
            "(" + "".join(f"distances[{i}, {j}], " for j in range(n_discs)) + "), "
            for i in range(n_discs)
        )
        + ")",
        centre=each(arms, "arms[{i}]"),
        gaps=each(n_discs, "gap_m - x_m[{i}] * sine"),
        ones=each(n_discs, "1.0"),
        zeros=each(n_discs, "0.0"),
        heights=spread(
            f"clamped_height({chained(spelling, 'height', 'flow.height_m[i]', 'i, flow')}, "
            "flow.radius_m)"
        ),
        areas=spread(chained(spelling, "coverage", "flow.coverage[i]", "i, flow")),
        images=_images(n_discs),
        bodies=_bodies(n_discs, arms),
        weight=weight,
        factors=spread(" * ".join([base.format(denominators), *products])),
        thrusts=each(n_discs, "k * speed[{i}] * speed[{i}] * factor[{i}]"),
        torque=summed(spelling, "torque", "0, flow"),
        dry_friction=summed(spelling, "dry_friction", "0, flow"),
        dry_width=summed(spelling, "dry_width", "0, flow"),
        speeds=spread(chained(spelling, "speed", "flow.speed_rad_s[i]", "i, flow")),
        gyro=gyro,
        lane_tuple=each(lanes, "{i}"),
        imports="{imports}",
    )
    return module_of(text.replace("{imports}", "\n".join(spelling.imports())), "pitch")


def _images(n: int) -> str:
    """Return what the neighbours' images contribute at each disc (eq. 3), as text.

    The sum of `aero.images.neighbour_images` without its loop: a loop inside would keep the
    compiler from running several lanes at once.
    """
    sums = []
    for i in range(n):
        terms = [
            f"area[{j}] * image_velocity(height[{i}], distances[{i}][{j}])"
            for j in range(n)
            if j != i
        ]
        sums.append(" + ".join(terms) or "0.0")
    return "(" + "".join(f"{text}, " for text in sums) + ")"


def _bodies(n: int, arms: int) -> str:
    """Return what all images contribute at the body's centre for each disc (eq. 4), as text."""
    sums = [
        " + ".join(f"image_velocity(height[{i}], arms[{j}])" for j in range(arms)) for i in range(n)
    ]
    return "(" + "".join(f"{text}, " for text in sums) + ")"
