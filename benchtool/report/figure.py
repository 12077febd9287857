"""Registry of figures, and the report pages that show them."""

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
Text = (
    str | Callable[..., str]
)  # format string, "{0.name}": attribute of the subject; or a function
Size = float | Callable[..., float]


def is_simulated(subject: Any) -> bool:
    """Return whether a subject, or any of several subjects, is simulated."""
    if hasattr(subject, "simulated"):
        return bool(subject.simulated)
    items = subject.values() if isinstance(subject, Mapping) else subject
    return any(is_simulated(item) for item in items)


@dataclass(slots=True, kw_only=True)
class FigureEntry:
    """Registered figure of a page: a function ``draw(figure, subject)`` fills an empty figure."""

    caption: Text
    title: Text
    page: str = ""  # default: folder of the module; for "folder.part", the text before the dot
    name: str = ""  # file name; default: name of the function
    when: Callable[[Any], bool] = lambda subject: True  # False: nothing to draw
    each: Callable[[Any], Mapping[str, Any]] | None = None  # a figure ``name_key`` per item
    height_in: Size = 4.5
    width_in: Size = WIDTH_IN
    simulated: bool | Callable[[Any], bool] = is_simulated
    layout: Literal["constrained"] | None = "constrained"  # None: `draw` positions the axes
    draw: Callable[..., None] = field(init=False)

    def __call__(self, draw: Draw) -> Draw:
        self.page = self.page or draw.__module__.rpartition(".")[0].rpartition(".")[2]
        self.name = self.name or draw.__name__
        if (self.page, self.name) in _FIGURES:
            raise ValueError(f"duplicate figure name {self.name} on page {self.page}; rename one")
        self.draw = draw
        _FIGURES[self.page, self.name] = self
        return draw

    def blocks(self, subject: Any) -> Iterator[tuple[str, FigureBlock]]:
        """Draw the figure, once per item of `each`; yield pairs of file name and block."""
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


def _value(value: Any, *subject: Any) -> Any:
    """Return a formatted text, the result of a function, or the value unchanged."""
    if isinstance(value, str):
        return value.format(*subject)
    return value(*subject) if callable(value) else value


@cache
def _load(folder: str) -> None:
    package = import_module(f"benchtool.report.{folder}")
    for module in iter_modules(package.__path__):
        import_module(f"{package.__name__}.{module.name}")


def registered_figures(page: str) -> dict[str, FigureEntry]:
    """Return the figures registered for a page, by name."""
    _load(page.partition(".")[0])
    return {name: entry for (entry_page, name), entry in _FIGURES.items() if entry_page == page}


def all_figures() -> list[FigureEntry]:
    """Return every figure of every folder, by page and name."""
    for module in iter_modules(import_module("benchtool.report").__path__):
        if module.ispkg:
            _load(module.name)
    return [_FIGURES[key] for key in sorted(_FIGURES)]


def render_figures(page: str, subject: Any, names: Iterable[str] = ()) -> dict[str, FigureBlock]:
    """Return drawable figures of a subject by file name; `names` default to all of the page."""
    registered = registered_figures(page)
    blocks: dict[str, FigureBlock] = {}
    for name in names or registered:
        if name not in registered:
            raise UnknownChoice(f"figure of the page {page}", name, registered)
        blocks |= registered[name].blocks(subject)
    return blocks


def captions(page: str) -> dict[str, str]:
    """Return the fixed captions of a page's figures by name."""
    texts = {name: entry.caption for name, entry in registered_figures(page).items()}
    return {name: text for name, text in texts.items() if isinstance(text, str)}


Part = str | Callable[[Any], Block | Sequence[Block] | None]  # a name or a block
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
            blocks = [block for part in parts for block in _blocks(part, subject, drawn)]
            if blocks:
                sections.append(Section(_value(title, subject), blocks))
        return sections

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


def _blocks(part: Part, subject: Any, figures: Mapping[str, FigureBlock]) -> Sequence[Block]:
    if isinstance(part, str):
        return [
            result for key, result in figures.items() if key == part or key.startswith(f"{part}_")
        ]
    result = part(subject)
    return result if isinstance(result, Sequence) else [] if result is None else [result]
