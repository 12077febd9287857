"""Colours of the page, from the palette of reports, for light and dark mode."""

from __future__ import annotations

from pathlib import Path

from nicegui import ui

from benchtool.report.palette import BLACK, BLUE, CYCLE, SKY

STATIC = Path(__file__).parent / "static"

ACCENT = "#0072b2"
STOP = "#b00020"  # red of STOP only; contrast of white text 7.3 to 1
ALARM = "#b34700"  # errors and warnings; contrast of white text 5.7 to 1
LIGHT_INK = "#e8eaed"  # replaces black in dark mode


def cycle(dark: bool) -> tuple[str, ...]:
    """Return the colour cycle of figures; in dark mode black is light and the blues are swapped."""
    on_dark = {BLACK: LIGHT_INK, BLUE: SKY, SKY: BLUE} if dark else {}
    return tuple(on_dark.get(color, color) for color in CYCLE)


def apply_theme(theme: str) -> ui.dark_mode:
    """Add colours, style sheets and scripts to the current page and return its dark mode."""
    ui.colors(primary=ACCENT, negative=ALARM, positive="#00704f", warning=ALARM, info=ACCENT)
    ui.button.default_props("no-caps")
    ui.add_head_html('<meta name="color-scheme" content="light dark">')
    for sheet in ("layout", "page", "shown"):
        ui.add_head_html(f'<link rel="stylesheet" href="/static/{sheet}.css">')
    ui.add_head_html('<script src="/static/shown.js" defer></script>')
    return ui.dark_mode({"light": False, "dark": True}.get(theme))
