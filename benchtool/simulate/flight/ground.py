"""What is below the discs of a vehicle in the air, and what it does to their thrust.

For each surface apart (`environment`): the fraction of each disc over it (exact for blocks, from
the samples of a grid), the disc's own height over it, and where its plane lies under the body, also
where that reaches beyond the surface's edge. With these the terms of eqs. (2) to (4) are summed as
for a sweep and a pitch bench (`physics.disc_thrust`), the images of the neighbours and of the body
being those over the same surface. A disc's factor is 1 + the sum over surfaces of
a (F - 1), times the effects' factors; those see what covers most of the disc. The floor takes what
the other surfaces leave. Below the validity of the formulae a height is held, and that is counted.
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable
from typing import Any

import numpy as np

from benchtool.physics.conditions import OUT_OF_GROUND_EFFECT_M
from benchtool.physics.coverage import half_plane_coverage, rectangle_coverage
from benchtool.physics.effects.effect import Flow
from benchtool.physics.expression import (
    Slot,
    expression,
    inlined_expression,
    read_record,
    with_fields,
    write_record,
)
from benchtool.physics.fold import unrolled
from benchtool.physics.tilt import LEVEL, Plane
from benchtool.simulate.flight.environment import BLOCK, MAP
from benchtool.simulate.flight.rigid_body import forward, leftward
from benchtool.simulate.hooks import LoopHooks

Below = namedtuple(
    "Below", "factor coverage height_m drag nearest_m touching held", defaults=(np.inf, 0.0, 0.0)
)
"""What is below: per disc T_IGE/T_OGE, the fraction over blocks and grid, the height over what
covers most of it (m, infinite over nothing, held where the formulae end), and the drag torque
over that far from any surface.

`nearest_m` is the least height of any disc over what it covers, before it is held; `touching`
and `held` are 1 where a disc touches something and where a height was held.
"""

DiscBelow = namedtuple(
    "DiscBelow", "x_m y_m z_m share height_m rest", defaults=(0.0, 0.0, 0.0, 0.0, 1.0, 1.0)
)
"""A disc over one surface: its centre in the world (m), the share of it over the surface, its
height over that (m); and the share that no surface covers yet.
"""

DISC = Slot(0, DiscBelow())  # one column of the scratch of a look: a disc
MIN_SHARE = 1e-300  # keeps a surface that is under no disc from dividing by nothing
HEIGHT_OVER_NOTHING_M = 1.0  # height of a disc without a share in a surface: no effect acts


@inlined_expression
def place_discs(body: Any, discs: Any, scratch: Any) -> None:
    """Write where the disc centres are in the world."""
    ahead, aside, n = forward(body), leftward(body), len(discs.x_m)
    for i in range(n):
        a, b = discs.x_m[i], discs.y_m[i]
        placed = DiscBelow(
            body.x_m + ahead[0] * a + aside[0] * b,
            body.y_m + ahead[1] * a + aside[1] * b,
            body.z_m + ahead[2] * a + aside[2] * b,
            0.0,
            HEIGHT_OVER_NOTHING_M,
            1.0,
        )
        write_record(scratch, DISC, i, n, placed)


@inlined_expression
def cover(scratch: Any, i: Any, n: Any, share: Any, height_m: Any) -> None:
    """Write the share of a disc over the present surface and its height over that."""
    disc = read_record(scratch, DISC, i, n)
    covered = DiscBelow(disc.x_m, disc.y_m, disc.z_m, share, height_m, disc.rest)
    write_record(scratch, DISC, i, n, covered)


@inlined_expression
def disc_on_rectangle(x: Any, y: Any, radius: Any, x1: Any, x2: Any, y1: Any, y2: Any) -> Any:
    """Return `rectangle_coverage`, worked out only where an edge cuts the disc.

    Where that is one edge alone, the area over its half plane is the same and costs a quarter.
    """
    if x + radius <= x1 or x - radius >= x2 or y + radius <= y1 or y - radius >= y2:
        return 0.0
    inside_x = x - radius >= x1 and x + radius <= x2
    inside_y = y - radius >= y1 and y + radius <= y2
    if inside_x and inside_y:
        return 1.0
    if inside_y and x2 - x1 >= 2.0 * radius:
        return half_plane_coverage(min(x - x1, x2 - x), radius)
    if inside_x and y2 - y1 >= 2.0 * radius:
        return half_plane_coverage(min(y - y1, y2 - y), radius)
    return rectangle_coverage(x, y, radius, x1, x2, y1, y2)


@inlined_expression
def distance_to_block(time_s: Any, block: Any) -> Any:
    """Return how far a plate is out of its place: 1 before and after, 0 while it is there."""
    if time_s < block.there_s:
        if time_s <= block.begins_s:
            return 1.0
        return (block.there_s - time_s) / (block.there_s - block.begins_s)
    if time_s > block.leaves_s:
        if time_s >= block.gone_s:
            return 1.0
        return (time_s - block.leaves_s) / (block.gone_s - block.leaves_s)
    return 0.0


@expression
def surface_rise(axis: Any, block: Any) -> Any:
    """Return how much more a place rises over a block's top per metre along an axis (3,)."""
    return axis[2] - block.slope_x * axis[0] - block.slope_y * axis[1]


@expression
def level_plane(body: Any, top_m: Any) -> Any:
    """Return the plane of a level surface under the body."""
    return Plane(body.z_m - top_m, forward(body)[2], leftward(body)[2])


@inlined_expression
def over_blocks(
    body: Any, surface: Any, time_s: Any, radius_m: Any, tables: Any, scratch: Any, n: Any,
    whole: Any,
) -> Any:  # fmt: skip
    """Write each disc's share and height over a surface of blocks; return summed share, plane."""
    total, n_blocks = 0.0, tables.blocks.shape[1]
    centre, slope_x, slope_y = 0.0, 0.0, 0.0
    for i in range(n):
        cover(scratch, i, n, 0.0, HEIGHT_OVER_NOTHING_M)
    for b in range(n_blocks):
        block = read_record(tables.blocks, BLOCK, b, n_blocks)
        if block.surface != surface:
            continue
        out = distance_to_block(time_s, block)
        dx, dy = out * block.slide_x_m, out * block.slide_y_m
        x1, x2, y1, y2 = block.x1_m + dx, block.x2_m + dx, block.y1_m + dy, block.y2_m + dy
        before = total
        for i in range(n):
            disc = read_record(scratch, DISC, i, n)
            x, y = disc.x_m, disc.y_m
            if whole > 0.0:  # a map that knows only whether a rotor's centre is over something
                share = 1.0 if x1 <= x <= x2 and y1 <= y <= y2 else 0.0
            else:
                share = disc_on_rectangle(x, y, radius_m, x1, x2, y1, y2)
            if share <= 0.0:
                continue
            top, steep = block.top_m, 1.0
            if block.slope_x != 0.0:
                top += block.slope_x * (min(max(x, x1), x2) - x1)
                steep += block.slope_x * block.slope_x
            if block.slope_y != 0.0:
                top += block.slope_y * (min(max(y, y1), y2) - y1)
                steep += block.slope_y * block.slope_y
            height = (disc.z_m - top) / np.sqrt(steep)
            both = disc.share + share
            cover(scratch, i, n, both, (disc.share * disc.height_m + share * height) / both)
            total += share
        if total > before:
            top, steep = block.top_m, 1.0
            if block.slope_x != 0.0:
                top += block.slope_x * (body.x_m - x1)
                steep += block.slope_x * block.slope_x
            if block.slope_y != 0.0:
                top += block.slope_y * (body.y_m - y1)
                steep += block.slope_y * block.slope_y
            here, normal = total - before, 1.0 / np.sqrt(steep)
            centre += here * (body.z_m - top) * normal
            slope_x += here * surface_rise(forward(body), block) * normal
            slope_y += here * surface_rise(leftward(body), block) * normal
    per_share = 1.0 / max(total, MIN_SHARE)
    return total, Plane(centre * per_share, slope_x * per_share, slope_y * per_share)


@inlined_expression
def over_grid(body: Any, seen: Any, map_: Any, scratch: Any, n: Any) -> Any:
    """Write share and height of every disc over the grid's rise; return the summed share and the
    plane: level, at the mean height of what is below the discs.
    """
    nx, ny = seen.shape[1], seen.shape[2]
    total, tops = 0.0, 0.0
    for i in range(n):
        disc = read_record(scratch, DISC, i, n)
        u = (disc.x_m - map_.grid_x_m) / map_.step_x_m
        v = (disc.y_m - map_.grid_y_m) / map_.step_y_m
        u = min(max(u, 0.0), nx - 1.0)
        v = min(max(v, 0.0), ny - 1.0)
        j, k = min(int(u), nx - 2), min(int(v), ny - 2)
        a, b = u - j, v - k
        w00, w01, w10, w11 = (1.0 - a) * (1.0 - b), (1.0 - a) * b, a * (1.0 - b), a * b
        share = w00 * seen[0, j, k] + w01 * seen[0, j, k + 1]
        share += w10 * seen[0, j + 1, k] + w11 * seen[0, j + 1, k + 1]
        top = w00 * seen[1, j, k] + w01 * seen[1, j, k + 1]
        top += w10 * seen[1, j + 1, k] + w11 * seen[1, j + 1, k + 1]
        cover(scratch, i, n, share, disc.z_m - top)
        total += share
        tops += share * top
    return total, level_plane(body, tops / max(total, MIN_SHARE))


@inlined_expression
def over_floor(body: Any, floor_m: Any, scratch: Any, n: Any) -> Any:
    """Write share and height of every disc over the floor; return summed share and plane."""
    total = 0.0
    if floor_m > -np.inf:
        for i in range(n):
            disc = read_record(scratch, DISC, i, n)
            share = max(disc.rest, 0.0)
            cover(scratch, i, n, share, disc.z_m - floor_m)
            total += share
    return total, level_plane(body, floor_m)


@expression
def coverage_of(ground: Any) -> Any:
    """Return the fraction of each disc over something: what is left uncovered, from one."""
    found = ground
    for i in range(len(ground)):
        found = with_fields(found, i, 1.0 - ground[i])
    return found


def surround(n: int, hooks: Callable[[], LoopHooks]) -> Callable[..., tuple[Below, Flow]]:
    """Return the function that looks below n discs, with the sum of a set of effects in it.

    It is called as f(time_s, pitch_rad, body, craft, discs, speed, p, tables, whole, scratch): the
    body and its pitch, a `Craft`, a `Geometry`, the discs' speeds (n,), the effects' numbers, the
    tables of an environment or of a map of it, 1 to count a disc as covered whole or not at all by
    its centre, and room for n columns of `DISC`. It returns what is below, and the flow that
    effects see which act on the disc as a whole.
    """
    shares = unrolled(n, expression(lambda i, scratch: read_record(scratch, DISC, i, n).share))
    heights = unrolled(n, expression(lambda i, scratch: read_record(scratch, DISC, i, n).height_m))
    rests = unrolled(n, expression(lambda i, scratch: read_record(scratch, DISC, i, n).rest))
    ones, nothing = (1.0,) * n, (np.inf,) * n

    @inlined_expression
    def look_below(
        time_s: Any, pitch_rad: Any, body: Any, craft: Any, discs: Any, speed: Any, p: Any,
        tables: Any, whole: Any, scratch: Any,
    ) -> tuple[Below, Flow]:  # fmt: skip
        parts, map_ = hooks(), read_record(tables.numbers, MAP, 0, 1)
        n_planes = int(map_.n_planes)
        place_discs(body, discs, scratch)
        factor, coverage, height = ones, ones, nothing
        over_all, nearest, touching, held = coverage_of(ones), np.inf, 0.0, 0.0
        for surface in range(n_planes + 2):
            total, plane = 0.0, LEVEL
            if surface < n_planes:
                total, plane = over_blocks(
                    body, surface, time_s, craft.radius_m, tables, scratch, n, whole
                )
            elif surface == n_planes:
                if map_.step_x_m > 0.0:
                    total, plane = over_grid(body, tables.seen, map_, scratch, n)
            else:
                coverage = coverage_of(rests(scratch))
                total, plane = over_floor(body, map_.floor_m, scratch, n)
            if total <= 0.0:
                continue
            share = shares(scratch)
            flow = parts.bare(
                craft.effective_radius_m, discs.x_m, discs.y_m, plane, heights(scratch), share,
                speed, time_s, pitch_rad, body.q_rad_s,
                airspeed=np.hypot(body.vx_m_s, body.vy_m_s),
            )  # fmt: skip
            flow = parts.with_images(flow, discs.distances_m, discs.body, p)
            given = parts.image_factors(flow, p)
            for i in range(n):
                factor = with_fields(factor, i, factor[i] + (given[i] - 1.0))
                over_all = with_fields(over_all, i, over_all[i] + flow.coverage[i])
                disc = read_record(scratch, DISC, i, n)
                if disc.share > 0.0:
                    nearest = min(nearest, disc.height_m)
                    if disc.height_m <= craft.depth_m:
                        touching = 1.0
                    least_m = parts.nearest_z_over_R * craft.effective_radius_m
                    if flow.height_m[i] <= least_m and flow.height_m[i] != disc.height_m:
                        held = 1.0
                    if disc.share >= 0.5 or height[i] == np.inf:
                        height = with_fields(height, i, flow.height_m[i])
                left = DiscBelow(
                    disc.x_m, disc.y_m, disc.z_m, disc.share, disc.height_m, disc.rest - disc.share
                )
                write_record(scratch, DISC, i, n, left)
        seen = height
        for i in range(n):
            seen = with_fields(seen, i, min(height[i], OUT_OF_GROUND_EFFECT_M))
        flow = parts.bare(
            craft.effective_radius_m, discs.x_m, discs.y_m, LEVEL, seen, over_all, speed, time_s,
            pitch_rad, body.q_rad_s,
        )  # fmt: skip
        drag, factor = parts.drags(factor, flow, p), parts.scaled(factor, flow, p)
        return Below(factor, coverage, height, drag, nearest, touching, held), flow

    return look_below
