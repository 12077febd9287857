"""Palette: each role has the same colour and marker in every figure.

Colours from Okabe and Ito, "Color Universal Design" (2008), distinguishable under the
common colour-vision deficiencies; markers and dashes repeat the distinction without colour.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Role = Literal[
    "single_rotor", "second_rig", "three_rotors", "quad", "model", "formula", "measurement", "muted"
]
BLACK = "#1b1b1b"
ORANGE = "#e69f00"
SKY = "#56b4e9"
GREEN = "#009e73"
BLUE = "#0072b2"
VERMILION = "#d55e00"
PURPLE = "#cc79a7"
GREY = "#6b7280"
PALE = "#d7dbe0"
OVER = "#bfe3c8"  # background while a rotor is over a surface; paper, figures 26 to 28
DASHED = (0, (5, 2.2))
DOTTED = (0, (1.5, 1.5))


@dataclass(frozen=True, slots=True)
class SeriesStyle:
    """Colour and marker of one role."""

    color: str
    marker: str


SERIES_STYLES: dict[Role, SeriesStyle] = {
    "single_rotor": SeriesStyle(BLUE, "o"),
    "second_rig": SeriesStyle(ORANGE, "s"),
    "three_rotors": SeriesStyle(PURPLE, "^"),
    "quad": SeriesStyle(GREEN, "D"),
    "model": SeriesStyle(VERMILION, "v"),
    "formula": SeriesStyle(BLACK, "x"),
    "measurement": SeriesStyle(BLACK, "o"),
    "muted": SeriesStyle(GREY, "."),
}
CYCLE = (BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY, BLACK, GREY)  # rotors 1 to 8, four ensembles
