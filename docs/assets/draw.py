"""Draw the figures of the documentation from the recipes in fits/: python docs/assets/draw.py

All of them show simulated recordings and say so.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from matplotlib.figure import Figure

from benchtool.fit.recipe import read_recipe
from benchtool.fit.run_recipe import run_recipe
from benchtool.report.demo_story import Story, overview
from benchtool.report.files import save_figure
from benchtool.report.paper_layouts import Series, paper_layouts

HERE = Path(__file__).parent
FITS = HERE.parents[1] / "fits"


def figures() -> dict[str, Figure]:
    """Draw every figure, by file name."""
    single, quad = (
        replace(read_recipe(FITS / name), methods=("least_squares",), compare=())
        for name in ("single_rotor", "quad")
    )
    story = Story(
        run_recipe(single),
        run_recipe(replace(quad, fix={"body_lift.K_b": 0.0})),
        run_recipe(quad),
    )
    layouts = paper_layouts(
        Series(
            single=FITS / "single_rotor",
            second=FITS / "amuse_rotor",
            three=FITS / "three_rotors",
            quad=FITS / "quad",
        )
    )
    return {"overview": overview(story), **layouts}


if __name__ == "__main__":
    for name, figure in figures().items():
        for path in save_figure(figure, HERE / name, ("svg",), replace=True):
            print(path)
