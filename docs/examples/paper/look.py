"""Colours, empty figures, arrows and the files that the scripts of this folder share."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

import benchtool as bt

BLACK, BLUE, GREEN, GREY, VERMILION = "#1b1b1b", "#0072b2", "#009e73", "#6b7280", "#d55e00"
ORANGE, PURPLE = "#e69f00", "#cc79a7"
OVER = "#bfe3c8"  # background while a rotor is over a surface, as in the paper's figures 26 to 28
DASHED = (0, (5, 2.2))

Figures = Mapping[str, Callable[[], Figure]]


def new_figure(title: str, width_in: float, height_in: float, *, simulated: bool = True) -> Figure:
    """Return an empty figure with a title and, over simulated data, a stamp."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    retitled(figure, title)
    if simulated:
        figure.text(
            0.99, 1.0 - 0.09 / height_in, "SIMULATED", ha="right", va="top", color=VERMILION,
            fontsize=9, fontweight="bold", gid="simulated-stamp",
        )  # fmt: skip
    return figure


def retitled(figure: Figure, title: str) -> Figure:
    """Set a figure's title, and return the figure."""
    figure.suptitle(title, x=0.012, ha="left", fontsize=11.5, fontweight="bold")
    return figure


def arrow(axes: Axes, begin: tuple[float, float], end: tuple[float, float], **look: Any) -> None:
    """Draw an arrow."""
    style = {"arrowstyle": "-|>", "color": BLACK, "linewidth": 1.5, **look}
    axes.annotate("", end, begin, arrowprops=style)


def save(figures: Figures, folder: str | Path = "") -> None:
    """Draw figures and write each as SVG to a folder: that of the command line, or `figures`."""
    out = Path(folder or (sys.argv[1:] or ["figures"])[0])
    out.mkdir(parents=True, exist_ok=True)
    for name, draw in figures.items():
        with bt.figure_style():
            draw().savefig(out / f"{name}.svg", metadata={"Date": None})
        print(f"written: {out / name}.svg", flush=True)
