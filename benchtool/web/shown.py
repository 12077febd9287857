"""What a process of its own has made ready for the page: HTML in pieces. Light to import."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Piece:
    """Hold one block as HTML, everything in it escaped; what may stand side by side says so."""

    html: str
    beside: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """Hold what a place of the page shows.

    Attributes:
        title: heading.
        pieces: in order.
        simulated: whether no physical bench made the data.
        command: words behind `benchtool` that make the same; empty where there is none.
    """

    title: str
    pieces: tuple[Piece, ...]
    simulated: bool = False
    command: tuple[str, ...] = ()
