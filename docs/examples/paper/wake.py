"""Flow below a hovering quadrotor, figure 5: sources with images, vortex rings with images.

Run: python docs/examples/paper/wake.py [FOLDER]

The first is the model behind eq. (2) to (4): every rotor a point source, mirrored below the ground.
It is irrotational everywhere and cannot show the upflow between the rotors. The second is a
prescribed wake, not a solution: every slipstream is a stack of vortex rings that contracts a
little, with images of opposite sign; it shows jets under the rotors and the fountain between them.
Neither predicts. Lengths are in rotor radii, velocities in induced velocities v_h of hover, heights
above ground.
"""

from __future__ import annotations

import numpy as np
from look import BLACK, BLUE, GREY, VERMILION, new_figure, save
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray
from scipy.special import ellipe, ellipk

Array = NDArray[np.float64]

SPACING, HEIGHT = 2.65, 2.0  # of the rotors (PQUAD: 0.318 m / 0.12 m), over the ground
ROTORS = 0.5 * SPACING * np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
SHEET = 2.0  # strength of a slipstream's vortex sheet: jump from still air to the far wake
LOWEST = 0.25  # height at which the wake ends: below it would have to turn outward
CORE = 0.08  # core radius of a ring: half the spacing of the stack; keeps the sheet smooth
RINGS = 60  # of a stack


def source_velocity(points: Array) -> Array:
    """Return the velocity (3, ...) of the sources and their images at points (3, ...).

    A rotor emits pi R^2 v into all directions: a source of strength R^2 v / 4, as the paper has it.
    """
    velocity = np.zeros_like(points)
    for x, y in ROTORS:
        for z in (HEIGHT, -HEIGHT):
            away = points - np.reshape([x, y, z], (3,) + (1,) * (points.ndim - 1))
            velocity += 0.25 * away / np.maximum(np.sqrt((away**2).sum(axis=0)), 1e-9) ** 3
    return velocity


def ring_velocity(radius: float, height: float, strength: float, rho: Array, z: Array) -> Array:
    """Return the axial and radial velocity (2, ...) of one vortex ring.

    A positive strength blows downward inside; rho is the distance of the points from the axis.
    Source: closed form with complete elliptic integrals (Lamb, Hydrodynamics, section 161), with a
    core added to the distance.
    """
    up = z - height
    far = (radius + rho) ** 2 + up**2 + CORE**2
    near = (radius - rho) ** 2 + up**2 + CORE**2
    m = 4.0 * radius * rho / far
    K, E = ellipk(m), ellipe(m)
    factor = strength / (2.0 * np.pi * np.sqrt(far))
    axial = -factor * (K + (radius**2 - rho**2 - up**2 - CORE**2) / near * E)
    outward = -K + (radius**2 + rho**2 + up**2 + CORE**2) / near * E
    radial = -factor * up / np.maximum(rho, 1e-6) * outward
    return np.array([axial, np.where(rho < 1e-6, 0.0, radial)])


def vortex_velocity(points: Array) -> Array:
    """Return the velocity (3, ...) of the ring stacks and their images at points (3, ...).

    The slipstream contracts in Landgrebe's form from 1 towards 0.87, slower than measured wakes and
    ending well above the ground: an assumption.
    """
    length = HEIGHT - LOWEST
    strength = SHEET * length / RINGS
    velocity = np.zeros_like(points)
    for x, y in ROTORS:
        dx, dy = points[0] - x, points[1] - y
        rho = np.hypot(dx, dy)
        total = np.zeros((2, *rho.shape))
        for depth in (np.arange(RINGS) + 0.5) * length / RINGS:
            radius, at = 0.87 + 0.13 * np.exp(-1.5 * depth), HEIGHT - depth
            total += ring_velocity(radius, at, strength, rho, points[2])
            total += ring_velocity(radius, -at, -strength, rho, points[2])
        safe = np.maximum(rho, 1e-9)
        velocity += np.array([total[1] * dx / safe, total[1] * dy / safe, total[0]])
    return velocity


FIELDS = {
    "sources + images": (source_velocity, "the model behind eq. (2) to (4)"),
    "vortex rings": (vortex_velocity, "with images: prescribed wake, not CFD"),
}


def centre_line(heights: Array) -> dict[str, Array]:
    """Return the upward velocity (n,) of each field on the axis of the body."""
    points = np.array([0.0 * heights, 0.0 * heights, heights])
    return {name: velocity(points)[2] for name, (velocity, _) in FIELDS.items()}


def table() -> str:
    """Return the velocities of both fields on the axis of the body as text."""
    heights = np.array([0.25, 0.5, 1.0, 1.5, 1.75, 2.0])
    lines = [f"{'height/R':<20}" + "".join(f"{height:>8.2f}" for height in heights)]
    for name, values in centre_line(heights).items():
        lines.append(f"{name:<20}" + "".join(f"{value:>+8.3f}" for value in values))
    return "\n".join(lines)


def flow() -> Figure:
    """Draw streamlines over vertical velocity of each field, and both centre lines (figure 5)."""
    title = f"Flow below a quadrotor at z/R = {HEIGHT:g}, diagonal plane (Fig. 5)"
    figure = new_figure(title, 9.4, 7.4)
    upper, lower = figure.subfigures(2, 1, height_ratios=[1.55, 1.0])
    along, height = np.linspace(-4.0, 4.0, 161), np.linspace(0.0, 2.6, 66)
    s, z = np.meshgrid(along / np.sqrt(2.0), height)
    panels = upper.subplots(2, 1, sharex=True)
    for axes, (name, (field, meaning)) in zip(panels, FIELDS.items(), strict=True):
        velocity = field(np.array([s, s, z]))
        shading = axes.pcolormesh(
            along, height, velocity[2], cmap="RdBu_r", shading="gouraud",
            norm=TwoSlopeNorm(0.0, -1.3, 0.65), rasterized=True,
        )  # fmt: skip
        axes.streamplot(
            along, height, (velocity[0] + velocity[1]) / np.sqrt(2.0), velocity[2], color=BLACK,
            linewidth=0.65, density=(1.8, 1.0), arrowsize=0.7,
        )  # fmt: skip
        hub = float(np.hypot(*ROTORS[0]))
        for side in (-hub, hub):
            axes.plot([side - 1.0, side + 1.0], [HEIGHT] * 2, color=BLACK, linewidth=3.2)
        axes.add_patch(Rectangle((-0.5, HEIGHT - 0.12), 1.0, 0.24, fc=GREY, ec="white"))
        axes.axhline(0.0, color=BLACK, linewidth=3.0)
        axes.set(title=f"{name}: {meaning}", ylabel="height / $R$", xlim=(-4.0, 4.0), ylim=(0, 2.6))
        axes.grid(False)
    panels[-1].set_xlabel("along the diagonal / $R$")
    upper.colorbar(shading, ax=panels, shrink=0.8, pad=0.01, label="upward velocity / $v_h$")
    axes, below = lower.subplots(), height[height <= HEIGHT + 1e-9]
    for (name, values), color in zip(centre_line(below).items(), (BLUE, VERMILION), strict=True):
        axes.plot(below, values, color=color, label=name)
    axes.axhline(0.0, color=GREY, linewidth=0.9)
    axes.set(xlabel="height on the centre line / $R$", ylabel="upward velocity / $v_h$")
    axes.set_title("Between the rotors: only the vortex rings show the fountain")
    axes.legend(loc="center")
    return figure


FIGURES = {"fig05-flow": flow}

if __name__ == "__main__":
    print(table())
    save(FIGURES)
