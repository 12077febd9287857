"""The registry of figures, and the pages that show them.

A figure is a function ``draw(figure, subject)`` in a module of its page's folder
(``report/fit/`` for the page "fit"), registered with its caption by `figure`. A page is a list of
sections, each of which names figures or calls functions that return other blocks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import Any, Literal, TypeVar

from matplotlib.figure import Figure

from benchtool.core.errors import UnknownChoice
from benchtool.report.page import Block, FigureBlock, Section
from benchtool.report.style import WIDTH_IN, look, new_figure

Draw = TypeVar("Draw", bound=Callable[..., None])
Text = str | Callable[..., str]
"""A text, in which "{0.name}" is replaced by an attribute of the subject, or what returns one."""

Size = float | Callable[..., float]


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureEntry:
    """Hold a registered figure; see `figure`."""

    page: str
    name: str
    caption: Text
    title: Text
    draw: Callable[..., None]
    when: Callable[[Any], bool]
    each: Callable[[Any], Mapping[str, Any]] | None
    height_in: Size
    width_in: Size
    simulated: bool | Callable[[Any], bool]
    layout: Literal["constrained"] | None

    def blocks(self, subject: Any) -> Iterator[tuple[str, FigureBlock]]:
        """Draw it, once for each item where it has several; give file name and block."""
        if not self.when(subject):
            return
        items = {"": ()} if self.each is None else _keyed(self.each(subject))
        for key, item in items.items():
            name = f"{self.name}_{key}" if key else self.name
            yield name, FigureBlock(self._drawn(subject, *item), _text(self.caption, subject, item))

    def _drawn(self, subject: Any, *item: Any) -> Figure:
        simulated = self.simulated
        with look():
            blank = new_figure(
                _text(self.title, subject, item),
                simulated=simulated if isinstance(simulated, bool) else simulated(subject),
                height_in=_size(self.height_in, subject, item),
                width_in=_size(self.width_in, subject, item),
                layout=self.layout,
            )
            self.draw(blank, subject, *item)
        return blank


def _keyed(items: Mapping[str, Any]) -> dict[str, tuple[Any, ...]]:
    return {key: (item,) for key, item in items.items()}


def _text(text: Text, subject: Any, item: Sequence[Any]) -> str:
    return text.format(subject, *item) if isinstance(text, str) else text(subject, *item)


def _size(size: Size, subject: Any, item: Sequence[Any]) -> float:
    return size(subject, *item) if callable(size) else size


_FIGURES: dict[tuple[str, str], FigureEntry] = {}


def figure(
    *,
    page: str,
    name: str,
    caption: Text,
    title: Text,
    when: Callable[[Any], bool] = lambda subject: True,
    each: Callable[[Any], Mapping[str, Any]] | None = None,
    height_in: Size = 4.5,
    width_in: Size = WIDTH_IN,
    simulated: bool | Callable[[Any], bool] = lambda subject: bool(subject.simulated),
    layout: Literal["constrained"] | None = "constrained",
) -> Callable[[Draw], Draw]:
    """Register a function ``draw(figure, subject)`` that fills an empty figure of a page.

    Args:
        page: what shows it; the part before a point is the folder of its module.
        name: of its file, and in its page's list of sections.
        caption: what is to be seen, in a sentence or two.
        title: one line over the figure.
        when: whether the subject has anything to draw; always when left out.
        each: the subject's items by key where the figure is drawn once for each: the function then
            takes the item as third argument, and its file is called ``name_key``.
        height_in: height in inches.
        width_in: width in inches.
        simulated: whether the figure is stamped; the subject's own ``simulated`` when left out.
        layout: None for a figure that places its axes by itself.
    """

    def register(draw: Draw) -> Draw:
        if (page, name) in _FIGURES:
            raise ValueError(f"page {page} has a figure {name} already; choose another name")
        _FIGURES[page, name] = FigureEntry(
            page=page,
            name=name,
            caption=caption,
            title=title,
            draw=draw,
            when=when,
            each=each,
            height_in=height_in,
            width_in=width_in,
            simulated=simulated,
            layout=layout,
        )
        return draw

    return register


@cache
def _load(folder: str) -> None:
    package = import_module(f"benchtool.report.{folder}")
    for module in iter_modules(package.__path__):
        import_module(f"{package.__name__}.{module.name}")


def figures_of(page: str) -> dict[str, FigureEntry]:
    """Return the figures registered for a page, by name."""
    _load(page.partition(".")[0])
    return {name: entry for (own, name), entry in _FIGURES.items() if own == page}


def drawn(page: str, subject: Any, names: Sequence[str] = ()) -> dict[str, FigureBlock]:
    """Return the figures that a subject allows, by the name of their files.

    Args:
        page: whose figures.
        subject: what they show.
        names: which, in this order; all of the page when left out.
    """
    known = figures_of(page)
    found: dict[str, FigureBlock] = {}
    for name in names or known:
        if name not in known:
            raise UnknownChoice(f"figure of the page {page}", name, known)
        found |= known[name].blocks(subject)
    return found


def captions(page: str) -> dict[str, str]:
    """Return the fixed captions of a page's figures by name."""
    texts = {name: entry.caption for name, entry in figures_of(page).items()}
    return {name: text for name, text in texts.items() if isinstance(text, str)}


Part = str | Callable[[Any], Sequence[Block]]


@dataclass(frozen=True, slots=True, eq=False)
class Page:
    """List the sections of a page.

    Attributes:
        name: the figures' page.
        layout: title and parts of each section, in order: the name of a figure, or a function of
            the subject that returns blocks. A section without any block is left out.
    """

    name: str
    layout: Sequence[tuple[Text, Sequence[Part]]]

    def __post_init__(self) -> None:
        PAGES[self.name] = self

    @property
    def figures(self) -> tuple[str, ...]:
        """Names of the figures, in the order of the page."""
        return tuple(part for _, parts in self.layout for part in parts if isinstance(part, str))

    def sections(
        self, subject: Any, figures: Mapping[str, FigureBlock] | None = None
    ) -> list[Section]:
        """Return the sections of a subject, with figures drawn before or drawn now."""
        shown = drawn(self.name, subject, self.figures) if figures is None else figures
        made = []
        for title, parts in self.layout:
            blocks: list[Block] = []
            for part in parts:
                blocks += _named(shown, part) if isinstance(part, str) else part(subject)
            if blocks:
                made.append(Section(_text(title, subject, ()), blocks))
        return made


def _named(shown: Mapping[str, FigureBlock], name: str) -> list[Block]:
    return [block for key, block in shown.items() if key == name or key.startswith(f"{name}_")]


PAGES: dict[str, Page] = {}
"""Every page of the modules that were imported, by name."""


def every_figure() -> list[FigureEntry]:
    """Return every figure of every folder, by page and name."""
    package = import_module("benchtool.report")
    for module in iter_modules(package.__path__):
        if module.ispkg:
            _load(module.name)
    return [_FIGURES[key] for key in sorted(_FIGURES)]
