"""The registry of figures, and the pages that show them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import Any, Literal, TypeVar

from benchtool.core.errors import UnknownChoice
from benchtool.report.page import Block, Commands, FigureBlock, Report, Section
from benchtool.report.style import WIDTH_IN, look, new_figure

Draw = TypeVar("Draw", bound=Callable[..., None])
Text = str | Callable[..., str]  # "{0.name}": an attribute of the subject; or a function of it
Size = float | Callable[..., float]


def is_simulated(subject: Any) -> bool:
    """Return whether a subject, or any of several, states that it is simulated."""
    if hasattr(subject, "simulated"):
        return bool(subject.simulated)
    several = subject.values() if isinstance(subject, Mapping) else subject
    return any(is_simulated(one) for one in several)


@dataclass(slots=True, kw_only=True)
class FigureEntry:
    """Register a function ``draw(figure, subject)`` that fills an empty figure of a page."""

    caption: Text
    title: Text
    page: str = ""  # default: folder of its module, which the part before a point is
    name: str = ""  # of its file and section; default: that of the function
    when: Callable[[Any], bool] = lambda subject: True  # has anything to draw
    each: Callable[[Any], Mapping[str, Any]] | None = None  # one figure, ``name_key``, per item
    height_in: Size = 4.5
    width_in: Size = WIDTH_IN
    simulated: bool | Callable[[Any], bool] = is_simulated
    layout: Literal["constrained"] | None = "constrained"  # None: places its axes itself
    draw: Callable[..., None] = field(init=False)

    def __call__(self, draw: Draw) -> Draw:
        self.page = self.page or draw.__module__.rpartition(".")[0].rpartition(".")[2]
        self.name = self.name or draw.__name__
        if (self.page, self.name) in _FIGURES:
            raise ValueError(f"page {self.page} has a figure {self.name} already; rename one")
        self.draw = draw
        _FIGURES[self.page, self.name] = self
        return draw

    def blocks(self, subject: Any) -> Iterator[tuple[str, FigureBlock]]:
        """Draw it, once for each item where it has several; give file name and block."""
        if not self.when(subject):
            return
        items = {"": ()} if self.each is None else {k: (v,) for k, v in self.each(subject).items()}
        for key, item in items.items():
            name, simulated = f"{self.name}_{key}" if key else self.name, self.simulated
            with look():
                blank = new_figure(
                    _value(self.title, subject, *item),
                    simulated=simulated if isinstance(simulated, bool) else simulated(subject),
                    height_in=_value(self.height_in, subject, *item),
                    width_in=_value(self.width_in, subject, *item),
                    layout=self.layout,
                )
                self.draw(blank, subject, *item)
            yield name, FigureBlock(blank, _value(self.caption, subject, *item))


figure = FigureEntry  # the decorator of a figure
_FIGURES: dict[tuple[str, str], FigureEntry] = {}


def _value(given: Any, *subject: Any) -> Any:
    """Return a text with the subject's attributes in it, what a function returns, or a number."""
    if isinstance(given, str):
        return given.format(*subject)
    return given(*subject) if callable(given) else given


@cache
def _load(folder: str) -> None:
    package = import_module(f"benchtool.report.{folder}")
    for module in iter_modules(package.__path__):
        import_module(f"{package.__name__}.{module.name}")


def registered_figures(page: str) -> dict[str, FigureEntry]:
    """Return the figures registered for a page, by name."""
    _load(page.partition(".")[0])
    return {name: entry for (own, name), entry in _FIGURES.items() if own == page}


def all_figures() -> list[FigureEntry]:
    """Return every figure of every folder, by page and name."""
    for module in iter_modules(import_module("benchtool.report").__path__):
        if module.ispkg:
            _load(module.name)
    return [_FIGURES[key] for key in sorted(_FIGURES)]


def render_figures(page: str, subject: Any, names: Iterable[str] = ()) -> dict[str, FigureBlock]:
    """Return the figures that a subject allows by their files' names; these, or all of the page."""
    known = registered_figures(page)
    found: dict[str, FigureBlock] = {}
    for name in names or known:
        if name not in known:
            raise UnknownChoice(f"figure of the page {page}", name, known)
        found |= known[name].blocks(subject)
    return found


def captions(page: str) -> dict[str, str]:
    """Return the fixed captions of a page's figures by name."""
    texts = {name: entry.caption for name, entry in registered_figures(page).items()}
    return {name: text for name, text in texts.items() if isinstance(text, str)}


Part = str | Callable[[Any], Block | Sequence[Block] | None]  # a name or a block
PAGES: dict[str, Page] = {}  # every page of the modules that were imported, by name


@dataclass(frozen=True, slots=True, eq=False)
class Page:
    """Titles and parts of a page's sections, or functions of them; empty sections are left out."""

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
        """Return the sections of a subject, with figures drawn before or drawn now."""
        shown = render_figures(self.name, subject, self.figures) if figures is None else figures
        made: list[Section] = []
        for item in self.layout:
            if not isinstance(item, tuple):
                made += item(subject)
                continue
            title, parts = item
            blocks = [block for part in parts for block in _blocks(part, subject, shown)]
            if blocks:
                made.append(Section(_value(title, subject), blocks))
        return made

    def report(
        self,
        subject: Any,
        commands: Sequence[str] = (),
        figures: Mapping[str, FigureBlock] | None = None,
    ) -> Report:
        return Report(
            title=_value(self.title, subject),
            summary=_value(self.summary, subject),
            sections=[*self.sections(subject, figures), Section("Made with", [Commands(commands)])],
            simulated=is_simulated(subject),
            highlights=self.highlights(subject),
        )


def _blocks(part: Part, subject: Any, shown: Mapping[str, FigureBlock]) -> Sequence[Block]:
    if isinstance(part, str):
        return [block for key, block in shown.items() if key == part or key.startswith(f"{part}_")]
    found = part(subject)
    return found if isinstance(found, Sequence) else [] if found is None else [found]
