"""Ground effect of the surfaces below a flying vehicle.

For each surface (`environment`): the covered fraction a of each disc (exact for blocks, from
samples for a grid), the height of the disc over it, and its plane under the body, extended beyond
its edge. From these the terms of eqs. (2) to (4) are summed as for a sweep and a pitch bench
(`physics.disc_thrust`); images of neighbours and body are those over the same surface. The factor
of a disc is 1 + the sum over surfaces of a (F - 1), times the factors of the effects, for the
surface that covers most of the disc. The floor covers the remaining fraction. Heights below the
validity limit of the formulae are clamped and counted.
"""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable
from typing import Any

import numpy as np

from benchtool.physics.conditions import OUT_OF_GROUND_EFFECT_M
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
from benchtool.physics.images import LEVEL, Plane, half_plane_coverage, rectangle_coverage
from benchtool.simulate.flight.environment import BLOCK, MAP
from benchtool.simulate.flight.vehicle import forward, leftward
from benchtool.simulate.hooks import LoopHooks

Below = namedtuple(
    "Below", "factor coverage height_m drag nearest_m touching clamped", defaults=(np.inf, 0.0, 0.0)
)
"""Surfaces below. Per disc: T_IGE/T_OGE, fraction over blocks and grid, height over the surface
that covers most of it (m, infinite without any, clamped to the validity limit), drag torque ratio
to OGE.

`nearest_m` is the least height of any disc before clamping; `touching` and `clamped` are 1 if a
disc touches a surface and if a height was clamped.
"""

# A disc over one surface: its centre in the world (m), its share and height (m) over the surface,
# and the share not covered by any surface so far.
DiscBelow = namedtuple(
    "DiscBelow", "x_m y_m z_m share height_m uncovered", defaults=(0.0, 0.0, 0.0, 0.0, 1.0, 1.0)
)

DISC = Slot(0, DiscBelow())  # one column of the scratch array: a disc
MIN_SHARE = 1e-300  # avoids 0/0 for a surface under no disc
UNCOVERED_HEIGHT_M = 1.0  # height of a disc with share 0, where no effect acts


@inlined_expression
def place_discs(body: Any, discs: Any, scratch: Any) -> None:
    """Write the disc centres in world axes."""
    x_axis, y_axis, n = forward(body), leftward(body), len(discs.x_m)
    for i in range(n):
        a, b = discs.x_m[i], discs.y_m[i]
        placed = DiscBelow(
            body.x_m + x_axis[0] * a + y_axis[0] * b,
            body.y_m + x_axis[1] * a + y_axis[1] * b,
            body.z_m + x_axis[2] * a + y_axis[2] * b,
            0.0,
            UNCOVERED_HEIGHT_M,
            1.0,
        )
        write_record(scratch, DISC, i, n, placed)


@inlined_expression
def cover(scratch: Any, i: Any, n: Any, share: Any, height_m: Any) -> None:
    """Write share and height of a disc over the present surface."""
    disc = read_record(scratch, DISC, i, n)
    covered = DiscBelow(disc.x_m, disc.y_m, disc.z_m, share, height_m, disc.uncovered)
    write_record(scratch, DISC, i, n, covered)


@inlined_expression
def disc_on_rectangle(x: Any, y: Any, radius: Any, x1: Any, x2: Any, y1: Any, y2: Any) -> Any:
    """Return `rectangle_coverage`, computed only if an edge cuts the disc.

    For a single edge the area over its half plane is equal and costs a quarter of the time.
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
def slide_share(time_s: Any, block: Any) -> Any:
    """Return the relative displacement of a moving plate: 0 in place, 1 before and after."""
    if time_s < block.insert_end_s:
        if time_s <= block.insert_start_s:
            return 1.0
        return (block.insert_end_s - time_s) / (block.insert_end_s - block.insert_start_s)
    if time_s > block.remove_start_s:
        if time_s >= block.remove_end_s:
            return 1.0
        return (time_s - block.remove_start_s) / (block.remove_end_s - block.remove_start_s)
    return 0.0


@expression
def surface_rise(axis: Any, block: Any) -> Any:
    """Return the change of height over the top of a block per metre along an axis (3,)."""
    return axis[2] - block.slope_x * axis[0] - block.slope_y * axis[1]


@expression
def level_plane(body: Any, top_m: Any) -> Any:
    """Return the plane of a level surface under the body."""
    return Plane(body.z_m - top_m, forward(body)[2], leftward(body)[2])


@inlined_expression
def over_blocks(
    body: Any, surface: Any, time_s: Any, radius_m: Any, tables: Any, scratch: Any, n: Any,
    whole_discs: Any,
) -> Any:  # fmt: skip
    """Write share and height of each disc over a surface of blocks; return summed share, plane."""
    total, n_blocks = 0.0, tables.blocks.shape[1]
    centre, slope_x, slope_y = 0.0, 0.0, 0.0
    for i in range(n):
        cover(scratch, i, n, 0.0, UNCOVERED_HEIGHT_M)
    for block_index in range(n_blocks):
        block = read_record(tables.blocks, BLOCK, block_index, n_blocks)
        if block.surface != surface:
            continue
        displacement = slide_share(time_s, block)
        dx, dy = displacement * block.slide_x_m, displacement * block.slide_y_m
        x1, x2, y1, y2 = block.x1_m + dx, block.x2_m + dx, block.y1_m + dy, block.y2_m + dy
        previous_total = total
        for i in range(n):
            disc = read_record(scratch, DISC, i, n)
            x, y = disc.x_m, disc.y_m
            if whole_discs > 0.0:  # by its centre alone
                share = 1.0 if x1 <= x <= x2 and y1 <= y <= y2 else 0.0
            else:
                share = disc_on_rectangle(x, y, radius_m, x1, x2, y1, y2)
            if share <= 0.0:
                continue
            top, squared_slope = block.top_m, 1.0
            if block.slope_x != 0.0:
                top += block.slope_x * (min(max(x, x1), x2) - x1)
                squared_slope += block.slope_x * block.slope_x
            if block.slope_y != 0.0:
                top += block.slope_y * (min(max(y, y1), y2) - y1)
                squared_slope += block.slope_y * block.slope_y
            height = (disc.z_m - top) / np.sqrt(squared_slope)
            summed_share = disc.share + share
            cover(
                scratch,
                i,
                n,
                summed_share,
                (disc.share * disc.height_m + share * height) / summed_share,
            )
            total += share
        if total > previous_total:
            top, squared_slope = block.top_m, 1.0
            if block.slope_x != 0.0:
                top += block.slope_x * (body.x_m - x1)
                squared_slope += block.slope_x * block.slope_x
            if block.slope_y != 0.0:
                top += block.slope_y * (body.y_m - y1)
                squared_slope += block.slope_y * block.slope_y
            block_total, normal = total - previous_total, 1.0 / np.sqrt(squared_slope)
            centre += block_total * (body.z_m - top) * normal
            slope_x += block_total * surface_rise(forward(body), block) * normal
            slope_y += block_total * surface_rise(leftward(body), block) * normal
    per_share = 1.0 / max(total, MIN_SHARE)
    return total, Plane(centre * per_share, slope_x * per_share, slope_y * per_share)


@inlined_expression
def over_grid(body: Any, cells: Any, numbers: Any, scratch: Any, n: Any) -> Any:
    """Write share and height of every disc over the raised cells of a grid; return the summed share
    and a level plane at the mean height of the cells below the discs.
    """
    nx, ny = cells.shape[1], cells.shape[2]
    total, tops = 0.0, 0.0
    for i in range(n):
        disc = read_record(scratch, DISC, i, n)
        u = (disc.x_m - numbers.grid_x_m) / numbers.step_x_m
        v = (disc.y_m - numbers.grid_y_m) / numbers.step_y_m
        u = min(max(u, 0.0), nx - 1.0)
        v = min(max(v, 0.0), ny - 1.0)
        j, k = min(int(u), nx - 2), min(int(v), ny - 2)
        a, b = u - j, v - k
        w00, w01, w10, w11 = (1.0 - a) * (1.0 - b), (1.0 - a) * b, a * (1.0 - b), a * b
        share = w00 * cells[0, j, k] + w01 * cells[0, j, k + 1]
        share += w10 * cells[0, j + 1, k] + w11 * cells[0, j + 1, k + 1]
        top = w00 * cells[1, j, k] + w01 * cells[1, j, k + 1]
        top += w10 * cells[1, j + 1, k] + w11 * cells[1, j + 1, k + 1]
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
            share = max(disc.uncovered, 0.0)
            cover(scratch, i, n, share, disc.z_m - floor_m)
            total += share
    return total, level_plane(body, floor_m)


def build_look_below(n: int, hooks: Callable[[], LoopHooks]) -> Callable[..., tuple[Below, Flow]]:
    """Return the function that evaluates the surfaces below n discs, with a set of effects.

    It is called as f(time_s, pitch_rad, body, craft, discs, speed, p, tables, whole_discs,
    scratch): body and pitch, a `Craft`, a `Geometry`, speeds of the discs (n,), parameters of the
    effects, tables of an environment or of its map, 1 to count a disc as covered as a whole or not
    at all by its centre, and an array for n columns of `DISC`. It returns a `Below`, and the flow
    for effects that act on the disc as a whole.
    """
    shares = unrolled(n, expression(lambda i, scratch: read_record(scratch, DISC, i, n).share))
    heights = unrolled(n, expression(lambda i, scratch: read_record(scratch, DISC, i, n).height_m))
    covered = unrolled(
        n, expression(lambda i, scratch: 1.0 - read_record(scratch, DISC, i, n).uncovered)
    )
    zeros, ones, infinite = (0.0,) * n, (1.0,) * n, (np.inf,) * n

    @inlined_expression
    def look_below(
        time_s: Any, pitch_rad: Any, body: Any, craft: Any, discs: Any, speed: Any, p: Any,
        tables: Any, whole_discs: Any, scratch: Any,
    ) -> tuple[Below, Flow]:  # fmt: skip
        functions, map_numbers = hooks(), read_record(tables.numbers, MAP, 0, 1)
        n_planes = int(map_numbers.n_planes)
        place_discs(body, discs, scratch)
        factor, coverage, height = ones, ones, infinite
        coverage_sum, nearest, is_touching, is_clamped = zeros, np.inf, 0.0, 0.0
        for surface in range(n_planes + 2):
            total, plane = 0.0, LEVEL
            if surface < n_planes:
                total, plane = over_blocks(
                    body, surface, time_s, craft.radius_m, tables, scratch, n, whole_discs
                )
            elif surface == n_planes:
                if map_numbers.step_x_m > 0.0:
                    total, plane = over_grid(body, tables.cells, map_numbers, scratch, n)
            else:
                coverage = covered(scratch)
                total, plane = over_floor(body, map_numbers.floor_m, scratch, n)
            if total <= 0.0:
                continue
            share = shares(scratch)
            flow = functions.bare(
                craft.effective_radius_m, discs.x_m, discs.y_m, plane, heights(scratch), share,
                speed, time_s, pitch_rad, body.q_rad_s,
                airspeed=np.sqrt(body.vx_m_s * body.vx_m_s + body.vy_m_s * body.vy_m_s),
            )  # fmt: skip
            flow = functions.with_images(flow, discs.distances_m, discs.body, p)
            surface_factors = functions.image_factors(flow, p)
            for i in range(n):
                factor = with_fields(factor, i, factor[i] + (surface_factors[i] - 1.0))
                coverage_sum = with_fields(coverage_sum, i, coverage_sum[i] + flow.coverage[i])
                disc = read_record(scratch, DISC, i, n)
                if disc.share > 0.0:
                    nearest = min(nearest, disc.height_m)
                    if disc.height_m <= craft.depth_m:
                        is_touching = 1.0
                    min_height_m = functions.nearest_z_over_R * craft.effective_radius_m
                    if flow.height_m[i] <= min_height_m and flow.height_m[i] != disc.height_m:
                        is_clamped = 1.0
                    if disc.share >= 0.5 or height[i] == np.inf:
                        height = with_fields(height, i, flow.height_m[i])
                uncovered = disc.uncovered - disc.share
                next_disc = DiscBelow(
                    disc.x_m, disc.y_m, disc.z_m, disc.share, disc.height_m, uncovered
                )
                write_record(scratch, DISC, i, n, next_disc)
        finite_height = height
        for i in range(n):
            finite_height = with_fields(finite_height, i, min(height[i], OUT_OF_GROUND_EFFECT_M))
        flow = functions.bare(
            craft.effective_radius_m, discs.x_m, discs.y_m, LEVEL, finite_height, coverage_sum,
            speed, time_s, pitch_rad, body.q_rad_s,
        )  # fmt: skip
        drag, factor = functions.drags(factor, flow, p), functions.scaled(factor, flow, p)
        return Below(factor, coverage, height, drag, nearest, is_touching, is_clamped), flow

    return look_below
