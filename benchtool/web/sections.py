"""Sections of the page that another process has made ready: HTML fragments. Light to import."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class HtmlFragment:
    """Hold one block as HTML, everything in it escaped; `beside`: it may stand side by side."""

    html: str
    beside: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class PageSection:
    """Hold what a place of the page shows.

    Attributes:
        simulated: whether no physical bench made the data.
        command: words behind `benchtool` that make the same; empty where there is none.
    """

    title: str
    fragments: tuple[HtmlFragment, ...]
    simulated: bool = False
    command: tuple[str, ...] = ()
