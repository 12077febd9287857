"""Sections of the page: report blocks as HTML with SVG figures.

Figures are embedded as images, so scripts in files of the runs folder cannot run. Report modules
are slow to import, so the functions are called in worker processes only.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from html import escape
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from benchtool.report.page import Block, Table

MAX_CELL_LENGTH = 45  # of a table beside a figure; assumed
TOOLS = "".join(
    f'<button type="button" data-does="{does}">{text}</button>'
    for does, text in (("large", "Enlarge"), ("svg", "SVG"), ("png", "PNG"))
)


@dataclass(frozen=True, slots=True)
class FigureImage:
    """Figure as SVG with its caption.

    `axes` from `figure_axes` let the page read values under the pointer; "" if unknown.
    """

    svg: bytes
    caption: str
    axes: str = ""


class Verdict(str):
    """Sentence that answers the question of a section, displayed large."""


class Tiles(dict[str, str]):
    """Most important values by name, displayed large."""


Content: TypeAlias = "Block | FigureImage"


@dataclass(frozen=True, slots=True)
class PageSection:
    """Section of the page."""

    title: str
    html: str  # of its blocks
    _: KW_ONLY
    simulated: bool = False
    command: tuple[str, ...] = ()  # arguments of the equivalent `benchtool` command
    details: Sequence[PageSection] = ()  # folded below


def as_html(*blocks: Content) -> str:
    """Return blocks as HTML with escaped text; figures and small tables may be side by side."""
    return "".join(map(_block_html, blocks))


def _block_html(block: Content) -> str:
    from benchtool.report import page
    from benchtool.report.figure import FigureBlock, figure_axes

    if isinstance(block, FigureBlock):
        block = FigureImage(block.svg, block.caption, figure_axes(block.figure))
    if isinstance(block, FigureImage):
        source = f"data:image/svg+xml;base64,{b64encode(block.svg).decode()}"
        caption = escape(block.caption)
        return (
            f'<figure class="shown block-beside"><img src="{source}" alt="{caption}" '
            f'data-axes="{escape(block.axes)}"><p class="figure-tools">{TOOLS}</p>'
            f"<figcaption>{caption}</figcaption></figure>"
        )
    if isinstance(block, str):
        css_class = ' class="verdict"' if isinstance(block, Verdict) else ""
        return f"<p{css_class}>{escape(block)}</p>"
    if isinstance(block, page.Heading):
        return f'<h3 class="card-title">{escape(block.text)}</h3>'
    if isinstance(block, Mapping):
        rows = "".join(
            f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>"
            for name, value in block.items()
        )
        css_class = "tiles" if isinstance(block, Tiles) else "facts"
        return f'<dl class="{css_class}">{rows}</dl>' if rows else ""
    if isinstance(block, page.Warnings):
        lines = "".join(f"<li>{escape(line)}</li>" for line in block.sentences)
        return f'<ul class="warn-box" aria-label="Warnings">{lines}</ul>' if lines else ""
    if isinstance(block, page.Commands):
        return _listing("\n".join(block.lines))
    if isinstance(block, page.Table):
        return _table(block)
    if isinstance(block, page.Listing):
        return f"<p>{escape(block.caption)}</p>{_listing(block.text)}"
    raise TypeError(f"block type {type(block).__name__} is not supported")


def _listing(text: str) -> str:
    return f'<pre tabindex="0"><code>{escape(text)}</code></pre>'


def _table(table: Table) -> str:
    def cell(tag: str, html: str, column: int) -> str:
        css_class = ' class="number"' if column >= table.text_columns else ""
        return f"<{tag}{css_class}>{html}</{tag.split()[0]}>"

    head = "".join(
        cell('th scope="col"', f'<button type="button">{escape(text)}</button>', column)
        for column, text in enumerate(table.header)
    )
    labels = (escape(text) for text in table.header[1:])  # shown on a narrow page
    tags = ('th scope="row"', *(f'td data-label="{label}"' for label in labels))
    body = "".join(
        "<tr>" + "".join(map(cell, tags, map(escape, row), range(len(row)))) + "</tr>"
        for row in table.rows
    )
    is_small = all(len(text) <= MAX_CELL_LENGTH for row in table.rows for text in row)
    return (
        f'<div class="wide{" block-beside" * is_small}" tabindex="0"><table class="shown">'
        f"<caption>{escape(table.caption)}</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )
