"""Moment of ground effect against a tilt of the whole vehicle, section 2.4 and figure 9.

Run: python docs/examples/paper/attitude.py [FOLDER]

The lower rotors of a tilted vehicle gain more. The moment is about the body's centre, which stays
at its height, for rotors that each give T = m g / n along their axis out of ground effect, n the
number of rotors, at any tilt. Thrusts that also keep the height, m g / (n cos(tilt)), give a
moment greater by 1/cos(tilt).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from drawings import draw_tilted
from look import BLUE, DASHED, GREEN, GREY, ORANGE, PURPLE, VERMILION, new_figure, save
from matplotlib.figure import Figure
from numpy.typing import NDArray

import benchtool as bt

Array = NDArray[np.float64]

GRAVITY_M_S2 = 9.81
K_B = 2.0  # body lift coefficient of the paper's figure 6

READINGS: dict[str, tuple[str, dict[str, Any]]] = {
    "images": ("eq. (4), images at $z_i + z_j$,\n$b$ half the diagonal", {}),
    "images_diagonal": (
        "eq. (4), images at $z_i + z_j$,\n$b$ the diagonal (printed)",
        {"body_distance": "diagonal"},
    ),
    "rotors_only": ("rotors only, eq. (3),\nimages at $z_i + z_j$", {}),
    "vertical": ("eq. (4), inflow taken\nalong the vertical", {"tilt_rule": "vertical"}),
    "own_height": ("eq. (4), each rotor's\nown height in it", {"tilt_rule": "own_height"}),
}
"""Readings of eqs. (3) and (4) under tilt; the first is the physics, the others named choices."""


def hover_authority_Nm(rig: bt.Rig) -> float:
    """Return the largest pitch torque at hover thrust: half the rotors' lift at their arms."""
    arms = np.abs([rotor.x_m for rotor in rig.rotors])
    return float(arms.sum() * rig.body.mass_kg * GRAVITY_M_S2 / rig.n_rotors)


def restoring_moment_Nm(
    rig: bt.Rig, z_over_R: Array, tilt_rad: Array, reading: str = "images"
) -> Array:
    """Return the moment (heights, tilts) about the pitch axis, positive against the tilt: N m."""
    model = bt.Model.single(rig).with_effect("neighbour_images")
    if reading != "rotors_only":  # eq. (10) has the body's term in each rotor's thrust
        model = model.with_effect("body_lift", K_b=K_B)
    model = replace(model, wake_rule="full", **READINGS[reading][1])
    z, tilt = np.meshgrid(np.asarray(z_over_R, float), tilt_rad, indexing="ij")
    factors = model.predict(np.ravel(z / np.cos(tilt)), tilt_rad=np.ravel(tilt))
    share_N = np.array(rig.rotors_on_disc) * rig.body.mass_kg * GRAVITY_M_S2 / rig.n_rotors
    moment: Array = (rig.disc_positions_m[:, 0] * share_N) @ (factors - 1.0)
    return moment.reshape(z.shape)


def level_moment_Nm(rig: bt.Rig, covered: int) -> float:
    """Return the moment of a level quadrotor at z/R = 2 with its front discs covered (section 3).

    One is the front alone, three the front and both sides.
    """
    model = bt.Model.single(rig).with_effect("neighbour_images").with_effect("body_lift", K_b=K_B)
    x_m = rig.disc_positions_m[:, 0]
    front = np.argsort(-x_m, kind="stable")[:covered]
    coverage = np.isin(np.arange(rig.n_discs), front).astype(float)
    factors = model.predict(2.0, coverage=coverage)[:, 0]
    return float(rig.body.mass_kg * GRAVITY_M_S2 / rig.n_discs * x_m @ (factors - 1.0))


def attitude() -> Figure:
    """Draw figure 9: a sketch, then the moment against tilt for each reading, on one scale."""
    rig, heights = bt.load_rig("pquad"), np.array([1.0, 1.5, 2.0, 3.0, 5.0])
    tilt_deg = np.linspace(0.0, 10.0, 41)
    moments_mNm = {
        name: 1e3 * restoring_moment_Nm(rig, heights, np.radians(tilt_deg), name)
        for name in READINGS
    }
    title = f"{rig.name}: ground effect turns a tilted vehicle back (Fig. 9)"
    figure = new_figure(title, 10.8, 7.6)
    sketch, *panels = figure.subplots(2, 3).ravel()
    draw_tilted(sketch, rig, 0.24, np.radians(10.0))
    top_mNm = 1.05 * max(float(moments.max()) for moments in moments_mNm.values())
    for axes, (name, moments) in zip(panels, moments_mNm.items(), strict=True):
        for height, moment, color in zip(
            heights, moments, (BLUE, ORANGE, GREEN, VERMILION, PURPLE), strict=True
        ):
            axes.plot(tilt_deg, moment, color=color, label=f"$z/R$ = {height:g}")
        axes.axhline(
            1e3 * level_moment_Nm(rig, 1), color=GREY, linestyle=DASHED, lw=1.1,
            label="level, one covered\nrotor at $z/R$ = 2",
        )  # fmt: skip
        axes.set(xlabel="tilt [deg]", ylabel="restoring moment [mN m]", title=READINGS[name][0])
        axes.set(xlim=(0.0, 10.0), ylim=(0.0, top_mNm))
    panels[0].legend(loc="upper left")
    whole_mNm = 1e3 * hover_authority_Nm(rig)
    share = panels[-1].secondary_yaxis(
        "right", functions=(lambda m: 100.0 * m / whole_mNm, lambda p: p * whole_mNm / 100.0)
    )
    share.set_ylabel("per cent of hover authority")
    return figure


FIGURES = {"fig09-attitude": attitude}

if __name__ == "__main__":
    save(FIGURES)
