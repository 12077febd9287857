"""Colours of the page: the reports' and figures' own, light and dark."""

from __future__ import annotations

from pathlib import Path

from nicegui import app, ui

from benchtool.report.palette import BLACK, BLUE, CYCLE, SKY

STATIC = Path(__file__).parent / "static"

ACCENT = "#0072b2"
STOP = "#b00020"  # A red used for Stop alone; white on it has a contrast of 7.3 to 1
ALARM = "#b34700"  # Errors and warnings; white on it has a contrast of 5.7 to 1
LIGHT_INK = "#e8eaed"  # Stands for black on a dark ground


def cycle(dark: bool) -> tuple[str, ...]:
    """Return the colours of numbered things, as in the figures; on a dark ground black turns light,
    and the two blues change places.
    """
    on_dark = {BLACK: LIGHT_INK, BLUE: SKY, SKY: BLUE} if dark else {}
    return tuple(on_dark.get(color, color) for color in CYCLE)


def apply_theme(theme: str) -> ui.dark_mode:
    """Give the present page its colours, and return its dark mode."""
    ui.colors(primary=ACCENT, negative=ALARM, positive="#00704f", warning=ALARM, info=ACCENT)
    ui.button.default_props("no-caps")
    ui.add_head_html('<meta name="color-scheme" content="light dark">')
    for sheet in ("layout", "page"):
        ui.add_head_html(f'<link rel="stylesheet" href="/static/{sheet}.css">')
    return ui.dark_mode({"light": False, "dark": True}.get(theme))


def serve_static() -> None:
    """Offer the style sheets under /static."""
    app.add_static_files("/static", STATIC)
