"""Report blocks as HTML with SVG figures; call only in worker processes, as drawing is slow.

Figures are embedded as images, so scripts in files of the runs folder cannot run.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape

from benchtool.report.figure import FigureBlock, figure_axes, figure_bytes
from benchtool.report.page import Block, Commands, Heading, Listing, Table, Warnings

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


Content = Block | FigureImage


def blocks_html(blocks: Iterable[Content]) -> str:
    """Return blocks as HTML with drawn figures; figures and tables may be placed side by side."""
    return "".join(
        f'<div class="block-beside">{as_html(block)}</div>'
        if isinstance(block, FigureBlock | FigureImage | Table)
        else as_html(block)
        for block in blocks
    )


def as_html(block: Content) -> str:
    """Return a block as HTML with escaped text."""
    if isinstance(block, FigureBlock):
        block = FigureImage(
            figure_bytes(block.figure, "svg"), block.caption, figure_axes(block.figure)
        )
    if isinstance(block, FigureImage):
        source = f"data:image/svg+xml;base64,{b64encode(block.svg).decode()}"
        caption = escape(block.caption)
        return (
            f'<figure class="shown"><img src="{source}" alt="{caption}" '
            f'data-axes="{escape(block.axes)}"><p class="figure-tools">{TOOLS}</p>'
            f"<figcaption>{caption}</figcaption></figure>"
        )
    if isinstance(block, str):
        return f"<p>{escape(block)}</p>"
    if isinstance(block, Heading):
        return f'<h3 class="card-title">{escape(block.text)}</h3>'
    if isinstance(block, Mapping):
        rows = "".join(
            f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in block.items()
        )
        return f'<dl class="facts">{rows}</dl>'
    if isinstance(block, Warnings):
        lines = "".join(f"<li>{escape(line)}</li>" for line in block.sentences)
        return f'<ul class="warn-box" aria-label="Warnings">{lines}</ul>' if lines else ""
    if isinstance(block, Commands):
        return f"<pre><code>{escape(chr(10).join(block.lines))}</code></pre>"
    if isinstance(block, Table):
        return _table(block)
    if isinstance(block, Listing):
        return f"<p>{escape(block.caption)}</p><pre><code>{escape(block.text)}</code></pre>"
    raise TypeError(f"block type {type(block).__name__} is not supported")


def _table(table: Table) -> str:
    def head_cell(text: str, column: int) -> str:
        css_class = ' class="number"' if column >= table.text_columns else ""
        return f'<th scope="col"{css_class}><button type="button">{escape(text)}</button></th>'

    def cell(tag: str, text: str, column: int, scope: str = "") -> str:
        css_class = ' class="number"' if column >= table.text_columns else ""
        return f"<{tag}{scope}{css_class}>{escape(text)}</{tag}>"

    head = "".join(head_cell(text, column) for column, text in enumerate(table.header))
    body = "".join(
        "<tr>"
        + cell("th", row[0], 0, ' scope="row"')
        + "".join(cell("td", text, column) for column, text in enumerate(row[1:], 1))
        + "</tr>"
        for row in table.rows
    )
    return (
        f'<div class="wide" tabindex="0"><table class="shown"><caption>{escape(table.caption)}'
        f"</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )
