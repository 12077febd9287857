"""Draw the overview of the documentation from the recipes in fits/: python docs/assets/draw.py

fig06-body-lift.svg is one of: python docs/examples/paper/ratios.py
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from benchtool.fit.recipe import read_recipe
from benchtool.fit.run_recipe import run_recipe
from benchtool.report.figure import FigureBlock, look, new_figure, save_figure
from benchtool.report.fit.figures import fitted_curve, ratio_points
from benchtool.report.ratio import draw_ratio

HERE = Path(__file__).parent
FITS = HERE.parents[1] / "fits"


def figures() -> dict[str, FigureBlock]:
    """Draw every figure, by file name."""
    single, quad = (
        replace(read_recipe(FITS / name), methods=("least_squares",), compare=())
        for name in ("single_rotor", "quad")
    )
    eq2 = run_recipe(single)
    eq3 = run_recipe(replace(quad, fix={"body_lift.K_b": 0.0}))
    eq4 = run_recipe(quad)
    z = np.linspace(0.5, 3.4, 240)
    series = [
        ratio_points(eq2, "one rotor (simulated bench)", "single_rotor"),
        ratio_points(eq4, "four rotors (simulated bench)", "quad"),
    ]
    one, three, four = (fitted_curve(fit, z) for fit in (eq2, eq3, eq4))
    curves = [
        replace(one, label="eq. (2), fitted to one rotor", role="single_rotor", bands=()),
        replace(three, label="eq. (3), best fit", role="quad", style="formula", bands=()),
        replace(four, label="eq. (4), fitted"),
    ]
    with look():
        overview = new_figure("Four rotors need the body lift", simulated=True, height_in=4.5)
        draw_ratio(overview, series, curves, "equal_rpm2")
    return {"overview": FigureBlock(overview, "")}


if __name__ == "__main__":
    for name, block in figures().items():
        for path in save_figure(block.figure, HERE / name, ("svg",), replace=True):
            print(path)
