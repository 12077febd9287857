"""Write docs/reference/figures.md from the registry: python docs/reference/write_figures.py"""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

from benchtool.report.figure import FigureEntry, all_figures

PAGE = Path(__file__).with_name("figures.md")

HEAD = """# Figures

Every figure that benchtool draws, by the page that shows it, made from the registry by
`docs/reference/write_figures.py`. The name is also that of its file. How to add one:
[write a figure](../how-to/extend.md#figures).
"""


def page() -> str:
    """Return the page."""
    parts = [HEAD]
    for name, entries in groupby(all_figures(), key=lambda entry: entry.page):
        rows = "\n".join(f"| `{entry.name}` | {describe(entry)} |" for entry in entries)
        parts.append(f"## {name}\n\n| figure | shows |\n|---|---|\n{rows}\n")
    return "\n".join(parts)


def describe(entry: FigureEntry) -> str:
    """Return the first line of the docstring of the figure function, else its caption."""
    text = entry.draw.__doc__ or entry.caption
    return text.strip().splitlines()[0] if isinstance(text, str) else entry.name


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
