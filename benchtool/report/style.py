"""Figure style: fonts, sizes, grid, title line and the SIMULATED stamp."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from textwrap import wrap
from threading import RLock
from typing import Any, Literal

import matplotlib as mpl
from matplotlib import rc_context
from matplotlib.figure import Figure

from benchtool.core.errors import UnknownChoice
from benchtool.report.palette import BLACK, GREY, PALE, VERMILION

WIDTH_IN = 7.0  # width of every figure: the text width of a printed A4 page, inches
TITLE_CHARACTERS = 69  # characters of a title per line at the full figure width
SIMULATED = "SIMULATED"
SIMULATED_GID = "simulated-stamp"
BASES = {  # quantity that is equal for both thrusts of a ratio
    "equal_power": "equal electrical power",
    "equal_pwm": "equal pwm",
    "equal_rpm2": "equal rpm²",
    "joint": "equal rpm² (joint fit)",
}
_OURS: dict[str, Any] = {
    "font.family": ["DejaVu Sans"],
    "font.size": 9.5,
    "axes.titlesize": 10.0,
    "axes.titlelocation": "left",
    "axes.labelsize": 10.0,
    "axes.labelcolor": BLACK,
    "axes.edgecolor": GREY,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "grid.color": PALE,
    "grid.linewidth": 0.6,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": BLACK,
    "ytick.labelcolor": BLACK,
    "legend.fontsize": 8.8,
    "legend.framealpha": 0.92,
    "legend.edgecolor": PALE,
    "legend.fancybox": False,
    "lines.linewidth": 1.6,
    "lines.markersize": 5.5,
    "errorbar.capsize": 2.5,
    "savefig.dpi": 160,
    "savefig.facecolor": "white",
    "hatch.linewidth": 0.5,
    "figure.constrained_layout.h_pad": 0.06,
    "figure.constrained_layout.w_pad": 0.06,
    "svg.hashsalt": "benchtool",
    "pdf.fonttype": 42,
}

# Settings of windows, keys and folders are not part of the style.
_NOT_LOOK = (
    "backend", "interactive", "toolbar", "keymap", "webagg", "tk.", "macosx", "docstring",
    "figure.hooks", "date.epoch", "savefig.directory", "timezone",
)  # fmt: skip
_LOOK: Any = {
    key: value for key, value in mpl.rcParamsDefault.items() if not key.startswith(_NOT_LOOK)
} | _OURS
_DRAWING = RLock()


@contextmanager
def look() -> Iterator[None]:
    """Apply the style over any matplotlibrc, then restore it; a lock admits one thread."""
    with _DRAWING, rc_context(_LOOK):
        yield


class NotebookFigure(Figure):
    """Figure with a notebook display that does not need pyplot."""

    def _repr_png_(self) -> bytes:
        buffer = BytesIO()
        with look():
            self.savefig(buffer, format="png", dpi=160)
        return buffer.getvalue()


def new_figure(
    title: str,
    *,
    simulated: bool,
    height_in: float,
    width_in: float = WIDTH_IN,
    layout: Literal["constrained"] | None = "constrained",
) -> Figure:
    """Return an empty figure with its title line, and a stamp if the data is simulated."""
    figure = NotebookFigure(figsize=(width_in, height_in), layout=layout)
    line_length = int(TITLE_CHARACTERS * width_in / WIDTH_IN) - (len(SIMULATED) + 2) * simulated
    text = figure.suptitle(
        "\n".join(wrap(title, line_length)), x=0.012, ha="left", fontsize=11.5, fontweight="bold"
    )
    if layout is None:
        text.set_y(1.0 - 0.09 / height_in)
    if simulated:
        figure.text(
            0.988, 1.0 - 0.09 / height_in, SIMULATED, ha="right", va="top", fontsize=9,
            fontweight="bold", color=VERMILION, gid=SIMULATED_GID,
            bbox={"boxstyle": "square,pad=0.25", "facecolor": "white", "edgecolor": VERMILION},
        )  # fmt: skip
    return figure


def ratio_label(basis: str) -> str:
    """Return the axis label of a thrust ratio with its basis of comparison."""
    if basis not in BASES:
        raise UnknownChoice("basis of comparison", basis, BASES)
    return "$T_{IGE}\\,/\\,T_{OGE}$ [–]  at " + BASES[basis]
