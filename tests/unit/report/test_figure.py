"""The registry of figures, on a page of the test's own."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
from matplotlib.figure import Figure

from benchtool.core.errors import UnknownChoice
from benchtool.report import figure as registry
from benchtool.report.figure import SIMULATED_GID, captions, figure, render_figures


@dataclass
class Subject:
    name: str = "lab"
    simulated: bool = True


@pytest.fixture(autouse=True)
def own_page(monkeypatch):
    """Register on the page "fit", whose own figures are loaded and put aside."""
    registry.all_figures()
    monkeypatch.setattr(registry, "_FIGURES", {})


def line(figure: Figure, subject: Subject) -> None:
    figure.subplots().plot([0.0, 1.0])


def test_texts_name_the_subject_and_the_stamp_is_its_own():
    figure(page="fit", name="line", title="Line: {0.name}", caption="Of {0.name}.")(line)
    block = render_figures("fit", Subject())["line"]
    assert block.figure.get_suptitle() == "Line: lab"
    assert block.caption == "Of lab."
    assert [text.get_gid() for text in block.figure.texts].count(SIMULATED_GID) == 1
    measured = render_figures("fit", Subject(simulated=False))["line"]
    assert SIMULATED_GID not in [text.get_gid() for text in measured.figure.texts]


def test_a_name_is_taken_once_and_an_unknown_one_refused():
    register = figure(page="fit", name="line", title="Line", caption="A line.")
    register(line)
    with pytest.raises(ValueError, match="duplicate figure name line on page fit"):
        register(line)
    with pytest.raises(UnknownChoice, match="figure of the page fit 'lime'; did you mean 'line'"):
        render_figures("fit", Subject(), ["lime"])
    assert captions("fit") == {"line": "A line."}
