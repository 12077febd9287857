"""The registry of figures and the pages made of them, on a page of the test's own."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest
from matplotlib.figure import Figure

from benchtool.core.errors import UnknownChoice
from benchtool.report import figure as registry
from benchtool.report.figure import Page, captions, drawn, figure
from benchtool.report.page import FigureBlock, Paragraph
from benchtool.report.style import SIMULATED_GID


@dataclass
class Subject:
    name: str = "lab"
    simulated: bool = True
    parts: dict[str, float] = field(default_factory=lambda: {"a": 1.0, "b": 2.0})


@pytest.fixture(autouse=True)
def own_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """Register on the page "fit", whose own figures are loaded and put aside."""
    registry.every_figure()
    monkeypatch.setattr(registry, "_FIGURES", {})
    monkeypatch.setattr(registry, "PAGES", {})


def line(figure: Figure, subject: Subject) -> None:
    figure.subplots().plot([0.0, 1.0])


def part(figure: Figure, subject: Subject, height: float) -> None:
    figure.subplots().plot([0.0, height])


def test_texts_name_the_subject_and_the_stamp_is_its_own() -> None:
    figure(page="fit", name="line", title="Line: {0.name}", caption="Of {0.name}.")(line)
    block = drawn("fit", Subject())["line"]
    assert block.figure.get_suptitle() == "Line: lab"
    assert block.caption == "Of lab."
    assert [text.get_gid() for text in block.figure.texts].count(SIMULATED_GID) == 1
    measured = drawn("fit", Subject(simulated=False))["line"]
    assert SIMULATED_GID not in [text.get_gid() for text in measured.figure.texts]


def test_a_figure_of_several_items_is_drawn_for_each() -> None:
    figure(
        page="fit", name="part", title=lambda subject, height: f"{height:g}", caption="A part.",
        each=lambda subject: subject.parts, height_in=lambda subject, height: 2.0 + height,
    )(part)  # fmt: skip
    blocks = drawn("fit", Subject())
    assert list(blocks) == ["part_a", "part_b"]
    assert [block.figure.get_figheight() for block in blocks.values()] == [3.0, 4.0]
    assert [block.figure.get_suptitle() for block in blocks.values()] == ["1", "2"]
    assert list(drawn("fit", Subject(parts={"": 1.0}))) == ["part"]


def test_a_name_is_taken_once_and_an_unknown_one_refused() -> None:
    register = figure(page="fit", name="line", title="Line", caption="A line.")
    register(line)
    with pytest.raises(ValueError, match="page fit has a figure line already"):
        register(line)
    with pytest.raises(UnknownChoice, match="figure of the page fit 'lime'; did you mean 'line'"):
        drawn("fit", Subject(), ["lime"])
    assert captions("fit") == {"line": "A line."}


def test_a_page_has_its_sections_in_order_without_empty_ones() -> None:
    figure(
        page="fit", name="line", title="Line", caption="A line.", when=lambda s: s.name == "lab"
    )(line)
    figure(
        page="fit", name="part", title="Part", caption="A part.", each=lambda s: s.parts
    )(part)  # fmt: skip
    page = Page(
        "fit",
        [
            ("{0.name}: all", ["part", lambda subject: [Paragraph(subject.name)], "line"]),
            ("Line", ["line"]),
            ("Words", [lambda subject: []]),
        ],
    )
    assert page.figures == ("part", "line", "line")
    every, alone = page.sections(Subject())
    assert (every.title, alone.title) == ("lab: all", "Line")
    kinds = [type(block) for block in every.blocks]
    assert kinds == [FigureBlock, FigureBlock, Paragraph, FigureBlock]
    assert [section.title for section in page.sections(Subject(name="x"))] == ["x: all"]
