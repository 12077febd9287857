"""Ground effect of every disc of a vehicle in the air, over everything that is below it.

For each surface apart (`environment`): the fraction a_i of each disc over it (exact for blocks,
from the samples of a grid), the disc's own height over it, and with these the sum of images as on
a bench. A disc's thrust factor is 1 + sum over surfaces of a_i (F_i - 1), the factor F_i seeing of
the neighbours only what lies over the same surface. The floor takes what the others leave.
Where the height is below the validity of the formulae it is held there, and that is counted.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from benchtool.core.array import Array
from benchtool.physics.body_lift import body_images, body_term
from benchtool.physics.coverage import half_plane_coverage, rectangle_coverage
from benchtool.physics.expression import Quantity, loop_part
from benchtool.physics.images import neighbour_images, partial_factor, self_image, thrust_factor
from benchtool.physics.validity import clamped_height
from benchtool.physics.wake_rules import (
    full_weight,
    mean_weight,
    notes_weight,
    pairs_weight,
    product_weight,
)
from benchtool.simulate.environment import Tables

RULES = ("notes", "full", "mean", "product", "pairs")
"""The wake rules in the order of their numbers here."""


class Discs(NamedTuple):
    """Hold what the aerodynamics need of a vehicle.

    Attributes:
        table: (3 + n, n) disc centres x and y in the body, c_j of the body term, and the distances
            between axes: m.
        radius_m: rotor radius, for areas.
        effective_radius_m: the R of the images' strength.
        neighbours: strength of the neighbours' images; 1 as in eq. (3).
        K_b: body lift coefficient; 0 without.
        rule: number of the wake rule in `RULES`.
        depth_m: how far hub and undercarriage reach below the discs, everywhere under them; 0
            leaves them out, so that only the discs touch.
    """

    table: Array
    radius_m: float
    effective_radius_m: float
    neighbours: float
    K_b: float
    rule: int
    depth_m: float


(
    PLACE_X, PLACE_Y, PLACE_Z, FACTOR, COVERAGE, HEIGHT, SHARE, OVER, REST, TOUCHES, HELD, NEAREST,
) = range(12)  # fmt: skip
"""Rows of what is found below the discs (12, n), written by `look_down`: disc centres in the world
(m), T_IGE/T_OGE, fraction over blocks and grid together, height over what covers most of the disc
(m, infinite over nothing); scratch: fraction and height on one surface, fraction that nothing
covers yet; 1 where the disc touches something, 1 where a height was held; and, over all calls, the
least height over anything (m)."""


def new_ground(n_discs: int) -> Array:
    """Return room for the findings below n discs (12, n)."""
    ground = np.zeros((12, n_discs))
    ground[NEAREST] = np.inf
    return ground


@loop_part
def wake_weight(rule: int, share: Array) -> Quantity:
    """Return the share of the body term that a wake rule grants."""
    if rule == 0:
        return notes_weight(share)
    if rule == 1:
        return full_weight(share)
    if rule == 2:
        return mean_weight(share)
    if rule == 3:
        return product_weight(share)
    return pairs_weight(share)


@loop_part
def place_discs(state: Array, table: Array, ground: Array) -> None:
    """Write where the disc centres are in the world."""
    w, x, y, z = state[6], state[7], state[8], state[9]
    for i in range(table.shape[1]):
        a, b = table[0, i], table[1, i]
        ground[PLACE_X, i] = (
            state[0] + (1.0 - 2.0 * (y * y + z * z)) * a + 2.0 * (x * y - w * z) * b
        )
        ground[PLACE_Y, i] = (
            state[1] + 2.0 * (x * y + w * z) * a + (1.0 - 2.0 * (x * x + z * z)) * b
        )
        ground[PLACE_Z, i] = state[2] + 2.0 * (x * z - w * y) * a + 2.0 * (y * z + w * x) * b


@loop_part
def disc_on_rectangle(
    x: float, y: float, radius: float, x1: float, x2: float, y1: float, y2: float
) -> Quantity:
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


@loop_part
def away(time_s: float, begins: float, there: float, leaves: float, gone: float) -> float:
    """Return how far a plate is out of its place: 1 before and after, 0 while it is there."""
    if time_s < there:
        if time_s <= begins:
            return 1.0
        return (there - time_s) / (there - begins)
    if time_s > leaves:
        if time_s >= gone:
            return 1.0
        return (time_s - leaves) / (gone - leaves)
    return 0.0


@loop_part
def over_blocks(
    surface: int, time_s: float, discs: Discs, blocks: Array, ground: Array, whole: bool
) -> float:
    """Write share and height of every disc over one surface of blocks; return the summed share."""
    total = 0.0
    for i in range(ground.shape[1]):
        ground[SHARE, i] = 0.0
        ground[OVER, i] = 1.0
    for b in range(len(blocks)):
        if blocks[b, 13] != surface:
            continue
        out = away(time_s, blocks[b, 7], blocks[b, 8], blocks[b, 9], blocks[b, 10])
        dx, dy = out * blocks[b, 11], out * blocks[b, 12]
        x1, x2 = blocks[b, 0] + dx, blocks[b, 1] + dx
        y1, y2 = blocks[b, 2] + dy, blocks[b, 3] + dy
        sx, sy = blocks[b, 5], blocks[b, 6]
        for i in range(ground.shape[1]):
            x, y = ground[PLACE_X, i], ground[PLACE_Y, i]
            if whole:  # a map that knows only whether a rotor's centre is over something
                share = 1.0 if x1 <= x <= x2 and y1 <= y <= y2 else 0.0
            else:
                share = disc_on_rectangle(x, y, discs.radius_m, x1, x2, y1, y2)
            if share <= 0.0:
                continue
            top = blocks[b, 4]
            steep = 1.0
            if sx != 0.0:
                top += sx * (min(max(x, x1), x2) - x1)
                steep += sx * sx
            if sy != 0.0:
                top += sy * (min(max(y, y1), y2) - y1)
                steep += sy * sy
            height = (ground[PLACE_Z, i] - top) / np.sqrt(steep)
            ground[OVER, i] = (ground[SHARE, i] * ground[OVER, i] + share * height) / (
                ground[SHARE, i] + share
            )
            ground[SHARE, i] += share
            total += share
    return total


@loop_part
def over_grid(discs: Discs, tables: Tables, ground: Array) -> float:
    """Write share and height of every disc over the grid's rise; return the summed share."""
    seen = tables.seen
    nx, ny = seen.shape[1], seen.shape[2]
    total = 0.0
    for i in range(ground.shape[1]):
        u = (ground[PLACE_X, i] - tables.grid_x_m) / tables.step_x_m
        v = (ground[PLACE_Y, i] - tables.grid_y_m) / tables.step_y_m
        u = min(max(u, 0.0), nx - 1.0)
        v = min(max(v, 0.0), ny - 1.0)
        j, k = min(int(u), nx - 2), min(int(v), ny - 2)
        a, b = u - j, v - k
        w00, w01, w10, w11 = (1.0 - a) * (1.0 - b), (1.0 - a) * b, a * (1.0 - b), a * b
        share = w00 * seen[0, j, k] + w01 * seen[0, j, k + 1]
        share += w10 * seen[0, j + 1, k] + w11 * seen[0, j + 1, k + 1]
        top = w00 * seen[1, j, k] + w01 * seen[1, j, k + 1]
        top += w10 * seen[1, j + 1, k] + w11 * seen[1, j + 1, k + 1]
        ground[SHARE, i] = share
        ground[OVER, i] = ground[PLACE_Z, i] - top
        total += share
    return total


@loop_part
def add_surface(discs: Discs, ground: Array) -> None:
    """Add what one surface gives to the factors, from the shares and heights just written."""
    n = ground.shape[1]
    for i in range(n):
        if ground[SHARE, i] > 0.0:
            ground[NEAREST, i] = min(ground[NEAREST, i], ground[OVER, i])
            if ground[OVER, i] <= discs.depth_m:
                ground[TOUCHES, i] = 1.0
            held = clamped_height(ground[OVER, i], discs.radius_m)
            if held > ground[OVER, i]:
                ground[HELD, i] = 1.0
            ground[OVER, i] = held
    weight = wake_weight(discs.rule, ground[SHARE])
    square = discs.effective_radius_m * discs.effective_radius_m
    shares, heights = ground[SHARE], ground[OVER]
    arms, distances = discs.table[2], discs.table[3:]
    for i in range(n):
        share = ground[SHARE, i]
        if share > 0.0:
            height = ground[OVER, i]
            images = self_image(height)
            if discs.neighbours != 0.0:
                images += discs.neighbours * neighbour_images(i, heights, shares, distances)
            total = square * images
            if discs.K_b * weight != 0.0:
                body = body_images(height, arms)
                total += body_term(discs.K_b, weight, discs.effective_radius_m, body)
            ground[FACTOR, i] += partial_factor(thrust_factor(total), share) - 1.0
            if share >= 0.5 or ground[HEIGHT, i] == np.inf:
                ground[HEIGHT, i] = height
        ground[REST, i] -= share


@loop_part
def look_down(
    time_s: float, state: Array, discs: Discs, tables: Tables, ground: Array, whole: bool
) -> None:
    """Write the factor, coverage and height of every disc at one instant.

    Args:
        time_s: since the flight began; moves plates.
        state: of the body (13, or more).
        discs: of the vehicle.
        tables: of the environment, or of a map of it.
        ground: is written to.
        whole: count a disc as covered whole or not at all, by its centre.
    """
    n = ground.shape[1]
    place_discs(state, discs.table, ground)
    for i in range(n):
        ground[FACTOR, i] = 1.0
        ground[REST, i] = 1.0
        ground[TOUCHES, i] = 0.0
        ground[HELD, i] = 0.0
        ground[HEIGHT, i] = np.inf
    for surface in range(tables.n_planes):
        if over_blocks(surface, time_s, discs, tables.blocks, ground, whole) > 0.0:
            add_surface(discs, ground)
    if tables.step_x_m > 0.0 and over_grid(discs, tables, ground) > 0.0:
        add_surface(discs, ground)
    for i in range(n):
        ground[COVERAGE, i] = 1.0 - ground[REST, i]
    if tables.floor_m > -np.inf:
        for i in range(n):
            ground[SHARE, i] = max(ground[REST, i], 0.0)
            ground[OVER, i] = ground[PLACE_Z, i] - tables.floor_m
        add_surface(discs, ground)
