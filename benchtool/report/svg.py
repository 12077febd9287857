"""Figures inside a page: one SVG element each, whose names clash with no other figure's."""

from __future__ import annotations

import re

from matplotlib.figure import Figure

from benchtool.report.files import figure_bytes

LARGEST = 1.25
"""A figure fills its column up to this many times its printed size."""

_PROLOGUE = re.compile(r"^.*?(?=<svg\b)", re.DOTALL)
_NAMESPACES = re.compile(r'\s+xmlns(?::\w+)?="[^"]*"')
_METADATA = re.compile(r"\s*<metadata>.*?</metadata>", re.DOTALL)
_SIZE = re.compile(r'(<svg\b[^>]*?)\s+width="([\d.]+)pt"([^>]*?)\s+height="[\d.]+pt"', re.DOTALL)
_REFERENCES = re.compile(r'(\bid="|url\(#|href="#)')


def inline_svg(figure: Figure, prefix: str) -> str:
    """Return the figure as an <svg> element for the inside of an HTML page.

    Args:
        figure: the figure.
        prefix: put before every id, so that two figures of a page share none.
    """
    text = figure_bytes(figure, "svg").decode("utf-8")
    text = _PROLOGUE.sub("", text, count=1)
    text = _METADATA.sub("", text)
    head, rest = text.split(">", 1)
    # HTML knows the namespaces by itself; without them the page names no address at all.
    head = _NAMESPACES.sub("", head)
    head = _SIZE.sub(
        lambda match: f'{match[1]}{match[3]} style="max-width:{LARGEST * float(match[2]):.0f}pt"',
        head + ">",
    )
    rest = rest.replace("xlink:href=", "href=")
    return _REFERENCES.sub(lambda match: match[1] + prefix + "-", head + rest).strip()
