"""Report as one self-contained HTML page: inline figures, no external resources."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path

from jinja2 import DictLoader, Environment, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from benchtool import __version__
from benchtool.core.errors import show_controls
from benchtool.report.files import check_not_existing, figure_bytes, write_whole
from benchtool.report.page import FigureBlock, Report

MAX_SCALE = 1.25  # figures fill their column up to this multiple of their printed size
_PROLOGUE = re.compile(r"^.*?(?=<svg\b)", re.DOTALL)
_NAMESPACES = re.compile(r'\s+xmlns(?::\w+)?="[^"]*"')
_METADATA = re.compile(r"\s*<metadata>.*?</metadata>", re.DOTALL)
_SIZE = re.compile(r'(<svg\b[^>]*?)\s+width="([\d.]+)pt"([^>]*?)\s+height="[\d.]+pt"', re.DOTALL)
_REFERENCES = re.compile(r'(\bid="|url\(#|href="#)')
_PAGE = "report.html.j2"
_STYLE = "report.css"


def render_report(report: Report) -> str:
    """Return the page; the text is reproducible for equal reports."""
    texts = files("benchtool.report") / "templates"
    environment = Environment(
        loader=DictLoader({_PAGE: (texts / _PAGE).read_text("utf-8")}),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    drawings = {
        id(block): Markup(inline_svg(block.figure, f"f{s}-{b}"))
        for s, section in enumerate(report.sections)
        for b, block in enumerate(section.blocks)
        if isinstance(block, FigureBlock)
    }
    page = environment.get_template(_PAGE).render(
        report=report,
        style=Markup((texts / _STYLE).read_text("utf-8")),
        anchors=_anchors([section.title for section in report.sections]),
        drawing=lambda block: drawings[id(block)],
        kind=lambda block: type(block).__name__,
        made=f"benchtool {__version__}",
    )
    return show_controls(page)


def write_report(path: Path, report: Report, *, replace: bool = False) -> Path:
    """Write the page and return its path; overwrite only with `replace`."""
    if not replace:
        check_not_existing([path])
    write_whole(path, render_report(report).encode("utf-8"))
    return path


def _anchors(titles: list[str]) -> list[str]:
    """Return an anchor for each heading, made from its words; equal headings are numbered."""
    anchors: list[str] = []
    for title in titles:
        stem = re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-") or "section"
        taken = sum(
            re.fullmatch(rf"{re.escape(stem)}(-\d+)?", name) is not None for name in anchors
        )
        anchors.append(f"{stem}-{taken + 1}" if taken else stem)
    return anchors


def inline_svg(figure: Figure, prefix: str) -> str:
    """Return the figure as an <svg> element; ids get a prefix, unique within the HTML page."""
    text = figure_bytes(figure, "svg").decode("utf-8")
    text = _PROLOGUE.sub("", text, count=1)
    text = _METADATA.sub("", text)
    head, body = text.split(">", 1)
    # HTML implies the namespaces; without them the page contains no address.
    head = _NAMESPACES.sub("", head)
    head = _SIZE.sub(
        lambda match: f'{match[1]}{match[3]} style="max-width:{MAX_SCALE * float(match[2]):.0f}pt"',
        head + ">",
    )
    body = body.replace("xlink:href=", "href=")
    return _REFERENCES.sub(lambda match: match[1] + prefix + "-", head + body).strip()
