"""Strip charts of the live stream: one canvas, its ring buffer in the browser."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

from nicegui.element import Element

from benchtool.core.channel import Channel
from benchtool.web.theme import STATIC, cycle

SECONDS = 30.0
"""What the charts look back; a choice."""


@dataclass(frozen=True, slots=True)
class StripLine:
    """Describe one line: position of its channel in the stream, label, colours light and dark."""

    column: int
    label: str
    light: str
    dark: str


@dataclass(frozen=True, slots=True)
class Strip:
    """Describe one strip: title, unit, factor from the channel's unit, decimals, lines."""

    title: str
    unit: str
    factor: float
    decimals: int
    lines: tuple[StripLine, ...]


_STRIPS: tuple[tuple[str, str, str, float, int], ...] = (
    ("Thrust", "thrust_N", "N", 1.0, 3),
    ("Speed", "rpm", "rpm", 1.0, 0),
    ("Pulse", "pwm_us", "us", 1.0, 0),
    ("Plate distance", "plate_z_m", "mm", 1e3, 1),
    ("Pitch", "theta_rad", "deg", 57.29577951308232, 2),
    ("Voltage", "voltage_V", "V", 1.0, 2),
    ("Current", "current_A", "A", 1.0, 2),
)
"""Title, family of channels, unit shown, factor to it, decimals."""


def strips_of(channels: Sequence[Channel]) -> tuple[Strip, ...]:
    """Return a strip for every family that a bench streams."""
    light, dark = cycle(dark=False), cycle(dark=True)
    strips = []
    for title, family, unit, factor, decimals in _STRIPS:
        columns = [
            column
            for column, channel in enumerate(channels)
            if "".join(letter for letter in channel.name if not letter.isdigit()) == family
        ]
        lines = tuple(
            StripLine(
                column,
                "".join(filter(str.isdigit, channels[column].name)) if len(columns) > 1 else "",
                light[place % len(light)],
                dark[place % len(dark)],
            )
            for place, column in enumerate(columns)
        )
        if lines:
            strips.append(Strip(title, unit, factor, decimals, lines))
    return tuple(strips)


class StripChart(Element, component=STATIC / "strip_chart.js"):
    """Show the strips of one connection.

    Args:
        session: number of the connection; frames of another are not shown.
        strips: in order.
    """

    def __init__(self, session: int, strips: Sequence[Strip]) -> None:
        super().__init__()
        self._props["session"] = session
        self._props["panels"] = [asdict(strip) for strip in strips]
        self._props["seconds"] = SECONDS
        self.classes("w-full")
