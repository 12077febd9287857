"""Draw the wiring of the Arduino bench: python docs/assets/draw_wiring.py"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from benchtool.report.figure import save_figure

HERE = Path(__file__).parent
INK, PAPER = "#222222", "#f6f4ee"
PLUS, GROUND, SIGNAL, POWER = "#c0392b", "#333333", "#1f6fb2", "#e08e0b"


@dataclass(frozen=True, slots=True)
class Box:
    """A part: its lower left corner, its size, its pins by name at (x, y), its name's shift."""

    name: str
    x: float
    y: float
    width: float
    height: float
    pins: dict[str, tuple[float, float]]
    shift: tuple[float, float] = (0.0, 0.0)

    def draw(self, axes: Axes) -> None:
        """Draw the part, its name, each pin's name inside its edge."""
        shape = FancyBboxPatch(
            (self.x, self.y),
            self.width,
            self.height,
            boxstyle="round,pad=0,rounding_size=0.12",
            facecolor=PAPER,
            edgecolor=INK,
            linewidth=1.2,
        )
        axes.add_patch(shape)
        x = self.x + self.width / 2 + self.shift[0]
        y = self.y + self.height / 2 + self.shift[1]
        axes.text(x, y, self.name, ha="center", va="center", fontsize=9, color=INK)
        for name, (x, y) in self.pins.items():
            axes.plot([x], [y], "s", color=INK, markersize=4, zorder=4)
            left, right = x <= self.x + 0.01, x >= self.x + self.width - 0.01
            if left or right:
                place = (x + (0.18 if left else -0.18), y)
                axes.text(*place, name, ha="left" if left else "right", va="center", fontsize=7)
            else:
                low = y <= self.y + 0.01
                place = (x, y + (0.18 if low else -0.18))
                axes.text(*place, name, ha="center", va="bottom" if low else "top", fontsize=7)


def wire(axes: Axes, colour: str, *corners: tuple[float, float]) -> None:
    """Draw a wire through its corners."""
    x, y = zip(*corners, strict=True)
    axes.plot(x, y, "-", color=colour, linewidth=1.6, solid_joinstyle="round", zorder=2)


def dot(axes: Axes, x: float, y: float, colour: str) -> None:
    """Mark where wires meet."""
    axes.plot([x], [y], "o", color=colour, markersize=4, zorder=4)


def resistor(axes: Axes, x: float, y: float, text: str) -> None:
    """Draw an upright resistor with its middle at (x, y)."""
    axes.add_patch(
        FancyBboxPatch(
            (x - 0.12, y - 0.25), 0.24, 0.5, boxstyle="square,pad=0", fc="white", ec=INK, zorder=3
        )
    )
    axes.text(x + 0.22, y, text, ha="left", va="center", fontsize=7)


def wiring() -> Figure:
    """Return the picture."""
    figure = Figure(figsize=(9.2, 5.6))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_xlim(0.0, 18.4)
    axes.set_ylim(0.0, 11.2)
    axes.set_axis_off()

    board = Box(
        "Arduino\nUno or Nano",
        7.2,
        2.6,
        3.2,
        6.6,
        {
            "USB": (8.8, 9.2),
            "5V": (7.2, 8.6),
            "D6": (7.2, 7.6),
            "D7": (7.2, 6.8),
            "GND": (7.2, 6.0),
            "5V ": (7.2, 4.8),
            "D2": (7.2, 4.0),
            "GND ": (7.2, 3.2),
            "D9": (10.4, 7.6),
            "GND  ": (10.4, 6.0),
            "A0": (10.4, 4.4),
        },
    )
    amplifier = Box(
        "HX711\nRATE to VCC: 80 per s",
        3.2,
        5.6,
        2.4,
        3.4,
        {
            "VCC": (5.6, 8.6),
            "DT": (5.6, 7.6),
            "SCK": (5.6, 6.8),
            "GND": (5.6, 6.0),
            "E+": (3.2, 8.6),
            "A-": (3.2, 7.73),
            "A+": (3.2, 6.87),
            "E-": (3.2, 6.0),
        },
        shift=(0.0, 2.2),
    )
    cell = Box(
        "load cell",
        0.4,
        5.6,
        1.5,
        3.4,
        {"red": (1.9, 8.6), "white": (1.9, 7.73), "green": (1.9, 6.87), "black": (1.9, 6.0)},
        shift=(0.0, 2.0),
    )
    speed = Box(
        "speed sensor\n(open collector)",
        2.6,
        2.6,
        3.0,
        2.6,
        {"5V": (5.6, 4.8), "OUT": (5.6, 4.0), "GND": (5.6, 3.2)},
        shift=(-0.4, 0.0),
    )
    esc = Box(
        "ESC",
        13.4,
        5.4,
        1.9,
        2.8,
        {"signal": (13.4, 7.6), "GND": (13.4, 6.0), "+": (15.3, 7.4), "-": (15.3, 6.2)},
    )
    motor = Box("motor", 13.6, 9.3, 1.5, 1.0, {})
    battery = Box("battery", 16.9, 5.4, 1.3, 2.8, {"+": (16.9, 7.4), "-": (16.9, 6.2)})
    computer = Box("computer", 7.8, 10.1, 2.0, 0.8, {})
    for box in (board, amplifier, cell, speed, esc, motor, battery, computer):
        box.draw(axes)

    wire(axes, INK, (8.8, 9.2), (8.8, 10.1))
    for y, colour in ((8.6, PLUS), (7.73, "#999999"), (6.87, "#2e8b57"), (6.0, GROUND)):
        wire(axes, colour, (1.9, y), (3.2, y))
    for y, colour in ((8.6, PLUS), (7.6, SIGNAL), (6.8, SIGNAL), (6.0, GROUND)):
        wire(axes, colour, (5.6, y), (7.2, y))
    for y, colour in ((4.8, PLUS), (4.0, SIGNAL), (3.2, GROUND)):
        wire(axes, colour, (5.6, y), (7.2, y))

    wire(axes, SIGNAL, (10.4, 7.6), (13.4, 7.6))
    wire(axes, GROUND, (10.4, 6.0), (13.4, 6.0))
    wire(axes, GROUND, (11.6, 7.6), (11.6, 6.0))
    dot(axes, 11.6, 7.6, SIGNAL)
    dot(axes, 11.6, 6.0, GROUND)
    resistor(axes, 11.6, 6.8, "10 k\u03a9")
    for x in (13.9, 14.35, 14.8):
        wire(axes, INK, (x, 8.2), (x, 9.3))
    wire(axes, POWER, (15.3, 7.4), (16.9, 7.4))
    wire(axes, GROUND, (15.3, 6.2), (16.9, 6.2))

    # The divider: battery, 100 kohm, A0, 6.8 kohm, ground. Wires meet where a dot is.
    wire(axes, POWER, (16.1, 7.4), (16.1, 5.3), (12.6, 5.3), (12.6, 4.4))
    wire(axes, SIGNAL, (10.4, 4.4), (12.6, 4.4))
    wire(axes, GROUND, (12.6, 4.4), (12.6, 2.9), (16.5, 2.9), (16.5, 6.2))
    resistor(axes, 12.6, 4.9, "100 k\u03a9")
    resistor(axes, 12.6, 3.8, "6.8 k\u03a9")
    for place in ((16.1, 7.4, POWER), (12.6, 4.4, SIGNAL), (16.5, 6.2, GROUND)):
        dot(axes, *place)

    legend = ((PLUS, "5 V"), (SIGNAL, "signal"), (GROUND, "ground"), (POWER, "battery +"))
    for index, (colour, text) in enumerate(legend):
        x = 7.4 + 2.2 * index
        wire(axes, colour, (x, 1.5), (x + 0.7, 1.5))
        axes.text(x + 0.85, 1.5, text, va="center", fontsize=8)
    notes = (
        "Second motor: its ESC at D10, its speed sensor at D3.",
        "Battery + reaches the Arduino through the divider only; the ESC's 5 V stays open.",
    )
    for index, text in enumerate(notes):
        axes.text(0.4, 0.9 - 0.45 * index, text, va="center", fontsize=8)
    return figure


if __name__ == "__main__":
    for path in save_figure(wiring(), HERE / "arduino-wiring", ("svg",), replace=True):
        print(path)
