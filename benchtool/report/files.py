"""Files of figures and report pages, with reproducible bytes; overwritten only on request.

A page is one self-contained HTML file: inline figures, no external resources.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from importlib.resources import files
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

from jinja2 import DictLoader, Environment, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure as Figure

from benchtool import __version__
from benchtool.core.errors import UnknownChoice, WouldOverwrite, show_controls
from benchtool.data.atomic import make_folder, replace_bytes
from benchtool.report.page import FigureBlock, Report
from benchtool.report.style import look

Format = Literal["svg", "png", "pdf"]

# No dates and versions: the bytes depend only on the data and the library.
_METADATA: dict[str, dict[str, Any]] = {
    "svg": {"Date": None, "Creator": None, "Format": None, "Type": None},
    "png": {"Software": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}

# Rasterised parts of a vector file (sampler traces) need less resolution than a whole png.
_RASTER_DPI = {"svg": 110, "png": 160, "pdf": 160}


def figure_bytes(figure: Figure, file_format: Format = "svg") -> bytes:
    """Return the contents of a figure file."""
    if file_format not in _METADATA:
        raise UnknownChoice("figure format", file_format, _METADATA)
    buffer = BytesIO()
    with look():
        figure.savefig(
            buffer,
            format=file_format,
            metadata=_METADATA[file_format],
            dpi=_RASTER_DPI[file_format],
        )
    return buffer.getvalue()


def figure_axes(figure: Figure) -> str:
    """Return axes as JSON: boxes (fractions of the figure from left and top), limits, labels."""
    boxes = []
    for axes in figure.axes:
        scales = (axes.get_xscale(), axes.get_yscale())
        if not axes.axison or not set(scales) <= {"linear", "log"}:
            continue
        position = axes.get_position()
        # Of several stacked axes only the lowest may have an x label.
        siblings = (axes, *axes.get_shared_x_axes().get_siblings(axes))
        label = next((sibling.get_xlabel() for sibling in siblings if sibling.get_xlabel()), "")
        boxes.append(
            {
                "box": [
                    round(edge, 4)
                    for edge in (position.x0, 1 - position.y1, position.x1, 1 - position.y0)
                ],
                "x": [*axes.get_xlim(), scales[0]],
                "y": [*axes.get_ylim(), scales[1]],
                "labels": [_plain(label), _plain(axes.get_ylabel())],
            }
        )
    return json.dumps(boxes)


def _plain(label: str) -> str:
    return re.sub(r"\\\w+|[${}]", "", label)


def save_figure(
    figure: Figure, stem: Path, formats: Sequence[Format] = ("svg", "png"), *, replace: bool = False
) -> tuple[Path, ...]:
    """Write `stem`.svg, `stem`.png, ... and return their paths; overwrite only with `replace`."""
    contents = {
        stem.with_name(f"{stem.name}.{name}"): figure_bytes(figure, name) for name in formats
    }
    if not replace:
        check_not_existing(contents)
    for path, content in contents.items():
        write_whole(path, content)
    return tuple(contents)


def check_not_existing(paths: Sequence[Path] | dict[Path, bytes]) -> None:
    """Raise WouldOverwrite if one of the files exists."""
    for path in paths:
        if path.exists():
            raise WouldOverwrite(str(path))


def write_whole(path: Path, content: bytes) -> None:
    """Write a file atomically; create its folder."""
    make_folder(path.parent)
    replace_bytes(path, content)


MAX_SCALE = 1.25  # figures fill their column up to this multiple of their printed size
_PROLOGUE = re.compile(r"^.*?(?=<svg\b)", re.DOTALL)
_NAMESPACES = re.compile(r'\s+xmlns(?::\w+)?="[^"]*"')
_METADATA_ELEMENT = re.compile(r"\s*<metadata>.*?</metadata>", re.DOTALL)
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
    text = _METADATA_ELEMENT.sub("", text)
    head, body = text.split(">", 1)
    # HTML implies the namespaces; without them the page contains no address.
    head = _NAMESPACES.sub("", head)
    head = _SIZE.sub(
        lambda match: f'{match[1]}{match[3]} style="max-width:{MAX_SCALE * float(match[2]):.0f}pt"',
        head + ">",
    )
    body = body.replace("xlink:href=", "href=")
    return _REFERENCES.sub(lambda match: match[1] + prefix + "-", head + body).strip()
