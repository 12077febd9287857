"""What a report page holds: sections of blocks, as values; `html` makes the page of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from matplotlib.figure import Figure

from benchtool.core.errors import InputError


@dataclass(frozen=True, slots=True)
class Paragraph:
    """Say something in plain text."""

    text: str


@dataclass(frozen=True, slots=True)
class Heading:
    """Begin a part within a section; it does not stand in the contents."""

    text: str


@dataclass(frozen=True, slots=True)
class FactTable:
    """List names with their values: rig, conditions, versions, hashes."""

    items: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Warnings:
    """List what the reader must know before using a number; nothing shows when there is none."""

    sentences: Sequence[str]


@dataclass(frozen=True, slots=True)
class Commands:
    """List the commands that made this, as they were typed."""

    lines: Sequence[str]


@dataclass(frozen=True, slots=True)
class Listing:
    """Quote a small text file as it stands (a plan)."""

    caption: str
    text: str


@dataclass(frozen=True, slots=True)
class Table:
    """Show rows of cells, already formatted."""

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    text_columns: int = 1  # on the left; the others are aligned as numbers

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.header):
                raise InputError(
                    f"the table {self.caption!r} has {len(self.header)} columns, but a row of "
                    f"{len(row)} cells: {', '.join(row)}"
                )

    def narrowed(self, columns: Sequence[int], caption: str = "", text_columns: int = 0) -> Table:
        return Table(
            caption or self.caption,
            [self.header[column] for column in columns],
            [[row[column] for column in columns] for row in self.rows],
            text_columns=text_columns or self.text_columns,
        )


@dataclass(frozen=True, slots=True, eq=False)
class FigureBlock:
    """Show a figure, which says in its caption what is to be seen."""

    figure: Figure
    caption: str


Block = Paragraph | Heading | FactTable | Warnings | Commands | Listing | Table | FigureBlock


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """Hold blocks under a heading."""

    title: str
    blocks: Sequence[Block]


@dataclass(frozen=True, slots=True, eq=False)
class Report:
    """Hold a whole page."""

    title: str
    summary: str
    sections: Sequence[Section]
    simulated: bool
    highlights: Mapping[str, str] = field(default_factory=dict)  # shown large
