"""A report as one self-contained HTML page: figures inline, nothing fetched from anywhere."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path

from jinja2 import DictLoader, Environment, StrictUndefined
from markupsafe import Markup

from benchtool.report.files import refuse_existing, write_whole
from benchtool.report.page import FigureBlock, Report
from benchtool.report.svg import inline_svg

_PAGE = "report.html.j2"
_STYLE = "report.css"


def render_report(report: Report) -> str:
    """Return the page; the same report gives the same text."""
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
    return environment.get_template(_PAGE).render(
        report=report,
        style=Markup((texts / _STYLE).read_text("utf-8")),
        anchors=_anchors([section.title for section in report.sections]),
        drawing=lambda block: drawings[id(block)],
        kind=lambda block: type(block).__name__,
    )


def write_report(path: Path, report: Report, *, replace: bool = False) -> Path:
    """Write the page and return its path; refuse to overwrite unless asked."""
    if not replace:
        refuse_existing([path])
    write_whole(path, render_report(report).encode("utf-8"))
    return path


def _anchors(titles: list[str]) -> list[str]:
    """Make a name for each heading from its words; equal headings are numbered."""
    anchors: list[str] = []
    for title in titles:
        stem = re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-") or "section"
        taken = sum(
            re.fullmatch(rf"{re.escape(stem)}(-\d+)?", name) is not None for name in anchors
        )
        anchors.append(f"{stem}-{taken + 1}" if taken else stem)
    return anchors
