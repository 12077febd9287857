"""Draw the figures of the documentation from the recipes in fits/: python docs/assets/draw.py

All of them show simulated recordings and say so.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from benchtool.fit.recipe import read_recipe
from benchtool.fit.run_recipe import run_recipe
from benchtool.report.figure import drawn
from benchtool.report.files import save_figure
from benchtool.report.fit.demo import Story
from benchtool.report.page import FigureBlock
from benchtool.report.paper.layouts import paper_layouts

HERE = Path(__file__).parent
FITS = HERE.parents[1] / "fits"
RECIPES = {
    "single": "single_rotor",
    "second": "amuse_rotor",
    "three": "three_rotors",
    "quad": "quad",
}


def figures() -> dict[str, FigureBlock]:
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
    layouts = paper_layouts({name: FITS / folder for name, folder in RECIPES.items()})
    return {**drawn("fit.demo", story), **layouts}


if __name__ == "__main__":
    for name, block in figures().items():
        for path in save_figure(block.figure, HERE / name, ("svg",), replace=True):
            print(path)
