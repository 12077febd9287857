"""T_IGE/T_OGE against z/R: figures 3, 4, 6 and 8, measured points over the formulae.

Run: python docs/examples/paper/ratios.py [FOLDER] [single=RUN] [second=RUN] [three=RUN] [quad=RUN]

The paper's own points are not public. The runs are those of `datasets/`, which are simulated, or
run folders of your own: one rotor, one rotor of another rig, three rotors, and the quadrotor.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from look import BLUE, GREEN, ORANGE, PURPLE, VERMILION, retitled, save
from matplotlib.figure import Figure

import benchtool as bt

ROOT = Path(__file__).parents[3]
RUNS: dict[str, tuple[str | Path, str | Path]] = {
    "single": (ROOT / "datasets/single_rotor/run", "single_bench"),
    "second": (ROOT / "datasets/amuse_rotor/run", ROOT / "fits/amuse_rotor/model.toml"),
    "three": (ROOT / "datasets/three_rotors/run", "quad_bench"),
    "quad": (ROOT / "datasets/quad/run", "quad_bench"),
}
"""Each run with the model that is fitted to it."""

K_B = 2.0  # body lift coefficient of the paper's figure 6


@cache
def fitted(name: str) -> Any:
    """Return the fit of a run."""
    return bt.fit(*RUNS[name])


def drawn(
    title: str,
    name: str,
    points: tuple[tuple[str, str, str], ...] = (),
    lifted: tuple[tuple[str, str], ...] = (),
) -> Figure:
    """Return the ratio figure of a fit, with points of other fits and curves of eq. (4) added.

    Points are given by run, label and colour; curves by distance of the body's images and label.
    """
    fit = fitted(name)
    figure = retitled(fit.plot("ratio"), title)
    (axes,) = figure.axes
    for other, label, color in points:
        table = fitted(other).to_dataframe("ratio")
        axes.errorbar(
            table["z_over_R"], table["ratio"], yerr=table["sd"], fmt="s", color=color, label=label
        )
    rig = fit.found.fitted.rig
    turning = np.arange(rig.n_rotors) < (3 if name == "three" else rig.n_rotors)
    z_over_R = np.linspace(0.5, axes.get_xlim()[1], 240)
    for (distance, label), color in zip(lifted, (VERMILION, PURPLE), strict=False):
        with_images = bt.Model.single(rig).with_effect("neighbour_images")
        model = replace(with_images.with_effect("body_lift", K_b=K_B), body_distance=distance)
        factors = model.predict(z_over_R, speed_rad_s=turning.astype(float))
        axes.plot(z_over_R, factors[turning].mean(axis=0), color=color, ls=":", label=label)
    axes.autoscale(axis="y")
    axes.legend(loc="upper right")
    return figure


def two_rigs() -> Figure:
    """Draw figure 3: one rotor of each of two rigs."""
    return drawn("One rotor of two sizes (Fig. 3)", "single", (("second", "larger rotor", ORANGE),))


def quad_and_single() -> Figure:
    """Draw figure 4: a quadrotor against one rotor."""
    points = (("single", "one rotor", BLUE),)
    return drawn("A quadrotor against one rotor (Fig. 4)", "quad", points)


def body_lift() -> Figure:
    """Draw figure 6: a quadrotor with body lift, with either reading of b."""
    curves = (
        ("half_diagonal", f"eq. (4), $K_b$ = {K_B:g}, $b$ half the diagonal"),
        ("diagonal", f"eq. (4), $K_b$ = {K_B:g}, $b$ the diagonal (printed)"),
    )
    points = (("single", "one rotor", GREEN),)
    return drawn("A quadrotor with body lift (Fig. 6)", "quad", points, curves)


def three_rotors() -> Figure:
    """Draw figure 8: three rotors, with the two thirds of the body lift that flights grant them."""
    curves = (("half_diagonal", f"with two thirds of $K_b$ = {K_B:g}"),)
    return drawn("Three rotors of a quadrotor (Fig. 8)", "three", (), curves)


FIGURES = {
    "fig03-two-rigs": two_rigs,
    "fig04-quad-and-single": quad_and_single,
    "fig06-body-lift": body_lift,
    "fig08-three-rotors": three_rotors,
}

if __name__ == "__main__":
    for word in sys.argv[1:]:
        name, _, run = word.partition("=")
        if run:
            RUNS[name] = (run, RUNS[name][1])
    save(FIGURES, next((word for word in sys.argv[1:] if "=" not in word), ""))
