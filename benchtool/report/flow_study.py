"""The flow picture of the paper's figure 5: two fields side by side, and their centre lines."""

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from benchtool.physics.wake_picture import Hover, source_velocity, vortex_velocity
from benchtool.report.files import Figure
from benchtool.report.flow import FlowPicture, flow_figure

Array = NDArray[np.float64]

HEIGHTS_R = (0.25, 0.5, 1.0, 1.5, 1.75, 2.0)
"""Heights of the centre-line table."""

REACH_R, TOP_R = 4.0, 2.6
"""Extent of the picture along the diagonal, to either side, and in height."""


def picture(label: str, hover: Hover, vortices: bool) -> FlowPicture:
    """Return one field in the diagonal plane."""
    along = np.linspace(-REACH_R, REACH_R, 161)
    height = np.linspace(0.0, TOP_R, 66)
    s, z = np.meshgrid(along, height)
    field = vortex_velocity if vortices else source_velocity
    velocity = field(hover, np.array([s / sqrt(2.0), s / sqrt(2.0), z]))
    across = (velocity[0] + velocity[1]) / sqrt(2.0)
    centre = centre_line(hover, height, vortices)
    return FlowPicture(label, along, height, across, velocity[2], centre)


def centre_line(hover: Hover, height_R: Array, vortices: bool) -> Array:
    """Return the upward velocity on the axis of the body (n,), in v_h."""
    zero = np.zeros_like(height_R)
    field = vortex_velocity if vortices else source_velocity
    upward: Array = field(hover, np.array([zero, zero, height_R]))[2]
    return upward


def flow_pictures(spacing_R: float = 2.65, height_R: float = 2.0) -> Figure:
    """Draw both pictures (Fig. 5): sources with images, vortex rings with images."""
    hover = Hover.quad(spacing_R, height_R)
    return flow_figure(
        [
            picture("sources and images (the model behind eq. 2 to 4)", hover, False),
            picture("vortex rings and images: prescribed wake, not CFD", hover, True),
        ],
        rotor_at_R=spacing_R / sqrt(2.0),
        rotor_height_R=height_R,
        title=f"Flow below a quadrotor at z/R = {height_R:g}, diagonal plane (Fig. 5)",
    )


def table_lines(spacing_R: float = 2.65, height_R: float = 2.0) -> list[str]:
    """Return the centre-line table of both pictures, in v_h."""
    hover = Hover.quad(spacing_R, height_R)
    heights = np.array([h for h in HEIGHTS_R if h <= height_R])
    lines = ["height/R            " + "".join(f"{h:>8.2f}" for h in heights)]
    for name, vortices in (("sources + images", False), ("vortex rings", True)):
        values = centre_line(hover, heights, vortices)
        lines.append(f"{name:<20}" + "".join(f"{v:>+8.3f}" for v in values))
    return lines
