"""Restoring moment against tilt: two readings of the body term side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchtool.report.geometry import Sketch, draw_tilted
from benchtool.report.palette import CYCLE, GREY
from benchtool.report.style import new_figure, styled

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class MomentCurves:
    """Hold the curves of one reading.

    Attributes:
        label: heading.
        tilt_deg: (t,).
        z_over_R: heights (h,).
        moment_mNm: (h, t), positive against the tilt.
    """

    label: str
    tilt_deg: Array
    z_over_R: Array
    moment_mNm: Array


@styled
def attitude_figure(
    readings: Sequence[MomentCurves],
    *,
    sketch: Sketch,
    authority_mNm: float,
    one_rotor_mNm: float,
    title: str,
) -> Figure:
    """Draw figure 9: a sketch, then the moment against tilt for each reading, on one scale.

    Args:
        readings: one panel each.
        sketch: of the vehicle.
        authority_mNm: largest control torque at hover, for the axis on the right.
        one_rotor_mNm: moment of one covered rotor at z/R = 2, drawn for comparison.
        title: one line.
    """
    figure = new_figure(title, simulated=True, height_in=4.3, width_in=3.2 * (len(readings) + 1))
    axes = figure.subplots(1, len(readings) + 1, width_ratios=[0.9] + [1.0] * len(readings))
    draw_tilted(axes[0], sketch, 0.24, np.radians(10.0))
    top = 1.05 * max(float(reading.moment_mNm.max()) for reading in readings)
    for panel, reading in zip(axes[1:], readings, strict=True):
        for height, moment, color in zip(reading.z_over_R, reading.moment_mNm, CYCLE, strict=False):
            panel.plot(reading.tilt_deg, moment, color=color, label=f"$z/R$ = {height:g}")
        panel.axhline(
            one_rotor_mNm, color=GREY, linestyle=(0, (5, 2.2)), lw=1.1,
            label="level, one covered\nrotor at $z/R$ = 2",
        )  # fmt: skip
        panel.set_title(reading.label)
        panel.set_xlabel("tilt [deg]")
        panel.set_ylim(0.0, top)
        panel.set_xlim(0.0, float(reading.tilt_deg[-1]))
    axes[1].set_ylabel("restoring moment [mN m]")
    axes[1].legend(loc="upper left")
    share = axes[-1].secondary_yaxis(
        "right",
        functions=(lambda m: 100.0 * m / authority_mNm, lambda p: p * authority_mNm / 100.0),
    )
    share.set_ylabel("per cent of hover authority")
    return figure
