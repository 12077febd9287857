"""Data model of a report page: sections of blocks. `html` renders it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from matplotlib.figure import Figure

from benchtool.core.errors import InputError


@dataclass(frozen=True, slots=True)
class Paragraph:
    """Plain text."""

    text: str


@dataclass(frozen=True, slots=True)
class Heading:
    """Subheading within a section; not listed in the table of contents."""

    text: str


@dataclass(frozen=True, slots=True)
class FactTable:
    """Names with values: rig, conditions, versions, hashes."""

    items: Mapping[str, str]


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


@dataclass(frozen=True, slots=True, eq=False)
class FigureBlock:
    """Figure with caption."""

    figure: Figure
    caption: str


Block = Paragraph | Heading | FactTable | Warnings | Commands | Listing | Table | FigureBlock


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
