"""Figures: style, registry by page, and files with reproducible bytes."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib import import_module
from io import BytesIO
from pathlib import Path
from pkgutil import iter_modules
from textwrap import wrap
from threading import RLock
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from benchtool.core.errors import UnknownChoice, WouldOverwrite
from benchtool.data.atomic import make_folder, replace_bytes
from benchtool.report.palette import BLACK, GREY, PALE, VERMILION

# matplotlib takes longer to import than most commands run: functions that draw import it.
if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

WIDTH_IN = 7.0  # width of every figure: the text width of a printed A4 page, inches
TITLE_CHARACTERS = 69  # characters of a title per line at the full figure width
SIMULATED = "SIMULATED"
SIMULATED_GID = "simulated-stamp"
_OURS: dict[str, Any] = {
    "font.family": ["DejaVu Sans"],
    "font.size": 9.5,
    "axes.titlesize": 10.0,
    "axes.titlelocation": "left",
    "axes.labelsize": 10.0,
    "axes.labelcolor": BLACK,
    "axes.edgecolor": GREY,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "grid.color": PALE,
    "grid.linewidth": 0.6,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": BLACK,
    "ytick.labelcolor": BLACK,
    "legend.fontsize": 8.8,
    "legend.framealpha": 0.92,
    "legend.edgecolor": PALE,
    "legend.fancybox": False,
    "lines.linewidth": 1.6,
    "lines.markersize": 5.5,
    "errorbar.capsize": 2.5,
    "savefig.dpi": 160,
    "savefig.facecolor": "white",
    "hatch.linewidth": 0.5,
    "figure.constrained_layout.h_pad": 0.06,
    "figure.constrained_layout.w_pad": 0.06,
    "svg.hashsalt": "benchtool",
    "pdf.fonttype": 42,
}

# Settings of windows, keys and folders are not part of the style.
_NOT_LOOK = (
    "backend", "interactive", "toolbar", "keymap", "webagg", "tk.", "macosx", "docstring",
    "figure.hooks", "date.epoch", "savefig.directory", "timezone",
)  # fmt: skip
_DRAWING = RLock()


@contextmanager
def look() -> Iterator[None]:
    """Apply the style over any matplotlibrc, then restore it; a lock admits one thread."""
    import matplotlib as mpl

    defaults: Any = mpl.rcParamsDefault
    style = {key: value for key, value in defaults.items() if not key.startswith(_NOT_LOOK)}
    with _DRAWING, mpl.rc_context(style | _OURS):
        yield


@cache
def _figure_class() -> type[Figure]:
    from matplotlib.figure import Figure

    class NotebookFigure(Figure):
        """Figure with a notebook display that does not need pyplot."""

        def _repr_png_(self) -> bytes:
            return figure_bytes(self, "png")

    return NotebookFigure


def legend_line(**style: Any) -> Line2D:
    """Return a line as handle of a legend."""
    from matplotlib.lines import Line2D

    return Line2D([], [], **style)


def legend_patch(**style: Any) -> Patch:
    """Return a filled box as handle of a legend."""
    from matplotlib.patches import Patch

    return Patch(**style)


def new_figure(
    title: str,
    *,
    simulated: bool,
    height_in: float,
    width_in: float = WIDTH_IN,
    layout: Literal["constrained"] | None = "constrained",
) -> Figure:
    """Return an empty figure with its title line, and a stamp if the data is simulated."""
    figure = _figure_class()(figsize=(width_in, height_in), layout=layout)
    line_length = int(TITLE_CHARACTERS * width_in / WIDTH_IN) - (len(SIMULATED) + 2) * simulated
    text = figure.suptitle(
        "\n".join(wrap(title, line_length)), x=0.012, ha="left", fontsize=11.5, fontweight="bold"
    )
    if layout is None:
        text.set_y(1.0 - 0.09 / height_in)
    if simulated:
        figure.text(
            0.988, 1.0 - 0.09 / height_in, SIMULATED, ha="right", va="top", fontsize=9,
            fontweight="bold", color=VERMILION, gid=SIMULATED_GID,
            bbox={"boxstyle": "square,pad=0.25", "facecolor": "white", "edgecolor": VERMILION},
        )  # fmt: skip
    return figure


@dataclass(frozen=True, eq=False)
class FigureBlock:
    """Figure with caption."""

    figure: Figure
    caption: str

    @cached_property
    def svg(self) -> bytes:
        """Contents of its SVG file, drawn once for the file and the page."""
        return figure_bytes(self.figure, "svg")


PACKAGE = "benchtool.report."
Draw = TypeVar("Draw", bound=Callable[..., None])
Text = str | Callable[..., str]  # a function of the subject, or its format: "{0.name}"
Size = float | Callable[..., float]


def is_simulated(subject: Any) -> bool:
    """Return whether a subject, or any of several subjects, is simulated."""
    if hasattr(subject, "simulated"):
        return bool(subject.simulated)
    return any(map(is_simulated, subject))


@dataclass(slots=True, kw_only=True)
class FigureEntry:
    """Registered figure of a page: a function ``draw(figure, subject)`` fills an empty figure."""

    caption: Text
    title: Text
    page: str = ""  # default: folder of the module; a further page of a folder is "folder.part"
    name: str = ""  # file name; default: name of the function
    when: Callable[[Any], bool] = lambda subject: True  # False: nothing to draw
    each: Callable[[Any], Mapping[str, Any]] | None = None  # a figure ``name_key`` per item
    height_in: Size = 4.5
    width_in: Size = WIDTH_IN
    simulated: bool | Callable[[Any], bool] = is_simulated
    layout: Literal["constrained"] | None = "constrained"  # None: `draw` positions the axes
    draw: Callable[..., None] = field(init=False)

    def __call__(self, draw: Draw) -> Draw:
        self.page = self.page or draw.__module__.removeprefix(PACKAGE).partition(".")[0]
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
            with look():
                blank = new_figure(
                    evaluate(self.title, subject, *item),
                    simulated=evaluate(self.simulated, subject),
                    height_in=evaluate(self.height_in, subject, *item),
                    width_in=evaluate(self.width_in, subject, *item),
                    layout=self.layout,
                )
                self.draw(blank, subject, *item)
            name = f"{self.name}_{key}" if key else self.name
            yield name, FigureBlock(blank, evaluate(self.caption, subject, *item))


figure = FigureEntry  # the decorator of a figure
_FIGURES: dict[tuple[str, str], FigureEntry] = {}


def evaluate(value: Any, *subject: Any) -> Any:
    """Return a formatted text, the result of a function, or the value unchanged."""
    if isinstance(value, str):
        return value.format(*subject)
    return value(*subject) if callable(value) else value


@cache
def _load(name: str) -> None:
    """Import a module of this package, and all modules of a folder."""
    package = import_module(PACKAGE + name)
    for module in iter_modules(getattr(package, "__path__", ())):
        import_module(f"{package.__name__}.{module.name}")


def registered_figures(page: str) -> dict[str, FigureEntry]:
    """Return the figures registered for a page, by name."""
    _load(page.partition(".")[0])
    return {name: entry for (entry_page, name), entry in _FIGURES.items() if entry_page == page}


def all_figures() -> list[FigureEntry]:
    """Return every figure of every folder, by page and name."""
    for module in iter_modules(import_module("benchtool.report").__path__):
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


Format = Literal["svg", "png", "pdf"]

# No dates and versions: the bytes depend only on the data and the library. Rasterised parts of a
# vector file (sampler traces) need less resolution than a whole png.
_FORMATS: dict[str, dict[str, Any]] = {
    "svg": {"dpi": 110, "metadata": dict.fromkeys(("Date", "Creator", "Format", "Type"))},
    "png": {"dpi": 160, "metadata": {"Software": None}},
    "pdf": {"dpi": 160, "metadata": dict.fromkeys(("CreationDate", "Creator", "Producer"))},
}


def figure_bytes(figure: Figure, file_format: Format = "svg") -> bytes:
    """Return the contents of a figure file."""
    if file_format not in _FORMATS:
        raise UnknownChoice("figure format", file_format, _FORMATS)
    buffer = BytesIO()
    with look():
        figure.savefig(buffer, format=file_format, **_FORMATS[file_format])
    return buffer.getvalue()


def figure_axes(figure: Figure) -> str:
    """Return axes as JSON: boxes (fractions of the figure from left and top), limits, labels."""
    boxes = []
    for axes in figure.axes:
        scales = (axes.get_xscale(), axes.get_yscale())
        if not axes.axison or not set(scales) <= {"linear", "log"}:
            continue
        position = axes.get_position()
        corners = (position.x0, 1 - position.y1, position.x1, 1 - position.y0)
        # Of several stacked axes only the lowest may have an x label.
        siblings = (axes, *axes.get_shared_x_axes().get_siblings(axes))
        label = next((sibling.get_xlabel() for sibling in siblings if sibling.get_xlabel()), "")
        boxes.append(
            {
                "box": [round(edge, 4) for edge in corners],
                "x": [*axes.get_xlim(), scales[0]],
                "y": [*axes.get_ylim(), scales[1]],
                "labels": [_plain(label), _plain(axes.get_ylabel())],
            }
        )
    return json.dumps(boxes)


def _plain(label: str) -> str:
    return re.sub(r"\\\w+|[${}]", "", label)


def save_figure(
    figure: Figure, stem: Path, formats: Sequence[Format] = ("svg", "png"), *, replace: bool = False
) -> list[Path]:
    """Write `stem`.svg, `stem`.png, ... and return their paths; overwrite only with `replace`."""
    contents = {
        stem.with_name(f"{stem.name}.{name}"): figure_bytes(figure, name) for name in formats
    }
    return _write_all(contents, replace=replace)


def save_figures(
    figures: Mapping[str, FigureBlock], folder: Path, *, replace: bool = False
) -> list[Path]:
    """Write an SVG and a PNG file per figure, named as its key; return their paths."""
    contents: dict[Path, bytes] = {}
    for name, block in figures.items():
        contents[folder / f"{name}.svg"] = block.svg
        contents[folder / f"{name}.png"] = figure_bytes(block.figure, "png")
    return _write_all(contents, replace=replace)


def _write_all(contents: Mapping[Path, bytes], *, replace: bool) -> list[Path]:
    if not replace:
        check_not_existing(contents)
    for path, content in contents.items():
        write_whole(path, content)
    return list(contents)


def check_not_existing(paths: Iterable[Path]) -> None:
    """Raise WouldOverwrite if one of the files exists."""
    for path in paths:
        if path.exists():
            raise WouldOverwrite(str(path))


def write_whole(path: Path, content: bytes) -> None:
    """Write a file atomically; create its folder."""
    make_folder(path.parent)
    replace_bytes(path, content)
