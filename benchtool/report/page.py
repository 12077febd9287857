"""Report pages: blocks, sections of a page, and one self-contained HTML file without resources."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchtool import __version__
from benchtool.core.errors import InputError, show_controls
from benchtool.report.figure import (
    FigureBlock,
    Text,
    check_not_existing,
    evaluate,
    is_simulated,
    render_figures,
    save_figures,
    write_whole,
)

if TYPE_CHECKING:
    pass


@dataclass(frozen=True, slots=True)
class Heading:
    """Subheading within a section; not listed in the table of contents."""

    text: str


@dataclass(frozen=True, slots=True)
class Warnings:
    """Warnings to read before using a number; an empty list shows nothing."""

    sentences: Sequence[str]


@dataclass(frozen=True, slots=True)
class Commands:
    """Commands that made this report, as typed."""

    lines: Sequence[str]


@dataclass(frozen=True, slots=True)
class Listing:
    """Small text file, quoted verbatim (a plan)."""

    caption: str
    text: str


@dataclass(frozen=True, slots=True)
class Table:
    """Table of formatted cells."""

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    text_columns: int = 1  # number of left-aligned columns; the others are aligned as numbers

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.header):
                raise InputError(
                    f"table {self.caption!r}: row with {len(row)} cells ({', '.join(row)}); "
                    f"required: {len(self.header)} cells"
                )

    def select_columns(
        self, columns: Sequence[int], caption: str = "", text_columns: int = 0
    ) -> Table:
        return Table(
            caption or self.caption,
            [self.header[column] for column in columns],
            [[row[column] for column in columns] for row in self.rows],
            text_columns=text_columns or self.text_columns,
        )


# A text is a paragraph, a mapping lists facts: rig, conditions, versions, hashes.
Block = str | Mapping[str, str] | Heading | Warnings | Commands | Listing | Table | FigureBlock


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """Blocks under a heading."""

    title: str
    blocks: Sequence[Block]


@dataclass(frozen=True, slots=True, eq=False)
class Report:
    """Report page."""

    title: str
    summary: str
    sections: Sequence[Section]
    simulated: bool
    highlights: Mapping[str, str] = field(default_factory=dict)  # large figures at the top


Part = str | Callable[[Any], Block | list[Block] | None]  # a name or a block
PAGE = "report.html"
PAGES: dict[str, Page] = {}  # pages of all imported modules, by name


@dataclass(frozen=True, slots=True, eq=False)
class Page:
    """Report page: section titles with their parts, or functions that return sections."""

    name: str
    layout: Sequence[tuple[Text, Sequence[Part]] | Callable[[Any], Sequence[Section]]]
    title: Text = ""
    summary: Text = ""
    highlights: Callable[[Any], Mapping[str, str]] = lambda subject: {}

    def __post_init__(self) -> None:
        PAGES[self.name] = self

    @property
    def figures(self) -> tuple[str, ...]:
        listed = [item[1] for item in self.layout if isinstance(item, tuple)]
        return tuple(part for parts in listed for part in parts if isinstance(part, str))

    def sections(
        self, subject: Any, figures: Mapping[str, FigureBlock] | None = None
    ) -> list[Section]:
        """Return the non-empty sections of a subject; without `figures`, draw them now."""
        drawn = render_figures(self.name, subject, self.figures) if figures is None else figures
        sections: list[Section] = []
        for item in self.layout:
            if not isinstance(item, tuple):
                sections += item(subject)
                continue
            title, parts = item
            blocks: list[Block] = []
            for part in parts:
                if isinstance(part, str):
                    blocks += [b for k, b in drawn.items() if k == part or k.startswith(f"{part}_")]
                elif (result := part(subject)) is not None:
                    blocks += result if isinstance(result, list) else [result]
            if blocks:
                sections.append(Section(evaluate(title, subject), blocks))
        return sections

    def report(
        self,
        subject: Any,
        commands: Sequence[str] = (),
        figures: Mapping[str, FigureBlock] | None = None,
    ) -> Report:
        return Report(
            title=evaluate(self.title, subject),
            summary=evaluate(self.summary, subject),
            sections=[*self.sections(subject, figures), Section("Made with", [Commands(commands)])],
            simulated=is_simulated(subject),
            highlights=self.highlights(subject),
        )

    def write(self, folder: Path, subject: Any, commands: Sequence[str] = ()) -> list[Path]:
        """Write figures and page to new files; return the page, then the files of the figures."""
        figures = render_figures(self.name, subject, self.figures)
        saved = save_figures(figures, folder)
        page = write_report(folder / PAGE, self.report(subject, commands, figures))
        return [page, *saved]


MAX_SCALE = 1.25  # figures fill their column up to this multiple of their printed size
_NAMESPACES = re.compile(r'\s+xmlns(?::\w+)?="[^"]*"')
_METADATA_ELEMENT = re.compile(r"\s*<metadata>.*?</metadata>", re.DOTALL)
_SIZE = re.compile(r'(<svg\b[^>]*?)\s+width="([\d.]+)pt"([^>]*?)\s+height="[\d.]+pt"', re.DOTALL)
_REFERENCES = re.compile(r'(\bid="|url\(#|href="#)')


def render_report(report: Report) -> str:
    """Return the page; the text is reproducible for equal reports."""
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    texts = files("benchtool.report") / "templates"
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    page = environment.from_string((texts / "report.html.j2").read_text("utf-8")).render(
        report=report,
        style=Markup((texts / "report.css").read_text("utf-8")),
        anchors=_anchors([section.title for section in report.sections]),
        drawing=lambda block, prefix: Markup(inline_svg(block.svg, prefix)),
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


def inline_svg(svg: bytes, prefix: str) -> str:
    """Return an SVG file as an <svg> element; ids get a prefix, unique within the HTML page."""
    text = svg.decode("utf-8")
    text = _METADATA_ELEMENT.sub("", text[text.index("<svg") :])
    head, body = text.split(">", 1)
    # HTML implies the namespaces; without them the page contains no address.
    head = _NAMESPACES.sub("", head)
    head = _SIZE.sub(
        lambda match: f'{match[1]}{match[3]} style="max-width:{MAX_SCALE * float(match[2]):.0f}pt"',
        head + ">",
    )
    body = body.replace("xlink:href=", "href=")
    return _REFERENCES.sub(lambda match: match[1] + prefix + "-", head + body).strip()
