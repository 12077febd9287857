"""The paper's figures in its order, as `benchtool simulate paper` writes them."""

from __future__ import annotations

from collections.abc import Iterator

from benchtool.physics.wake_picture import Hover
from benchtool.report.figure import Page, drawn
from benchtool.report.page import FigureBlock
from benchtool.report.paper.flights import EXTRA, FLIGHTS, Flies

PAPER = Page(
    "paper",
    [
        (
            "Models",
            [
                *("fig03-single-rotor", "fig04-quad-and-single", "fig06-body-lift"),
                *("fig08-three-rotors", "fig09-attitude"),
            ],
        ),
        (
            "Set-ups",
            ["fig07-partial-effect", "fig10-map", "fig11-cases", "fig29-plate-set-up"],
        ),
        ("Controllers", ["fig16-observer-scheme", "fig19-feedforward-scheme"]),
        (
            "Flights",
            [
                *(f"fig{number}-{control}-{case}" for number, control, case in FLIGHTS),
                *("fig14-pid-1-m-s", "fig15-pid-noise", "fig22-map-errors"),
                *("fig23-comparison-over", "fig24-comparison-edge", "fig30-plate-in-flight"),
                *(f"extra-{case}" for case in EXTRA),
            ],
        ),
        (
            "The pitch bench",
            [
                *("fig26a-bench-pquad", "fig26b-bench-amuse", "fig27-bench-feedforward"),
                *("fig27-bench-switched", "fig28-bench-observer"),
            ],
        ),
    ],
)


def paper_figures(flights: Flies) -> Iterator[tuple[str, FigureBlock]]:
    """Give every figure with its file name, one after the other."""
    yield from drawn("paper.flow", Hover.quad()).items()
    for name in PAPER.figures:
        yield from drawn("paper", flights, [name]).items()
