"""The report page: complete, self-contained, safe against what it quotes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from benchtool.core.errors import InputError
from benchtool.report.figure import FigureBlock
from benchtool.report.numbers import value_with_sd
from benchtool.report.page import Commands, Report, Section, Table, Warnings, render_report
from benchtool.report.ratio import Curve, RatioPoints, draw_ratio


def figure_block(caption: str) -> FigureBlock:
    z = np.array([0.5, 1.0, 2.0])
    points = RatioPoints(z, 1.0 + 0.1 / z, np.full(3, 0.01), "rotor")
    figure = Figure()
    draw_ratio(figure, [points], [Curve(z, 1.0 + 0.1 / z, "PFI")], "equal_rpm2")
    return FigureBlock(figure, caption)


def report() -> Report:
    return Report(
        "A plate <sweep> & its fit",
        "The answer.",
        [
            Section("What was done", ["Thrust < 30 N & more.", figure_block("First.")]),
            Section("Conditions", [{"air density": "1.19 kg/m³"}, figure_block("Second.")]),
            Section("Conditions", [Warnings(["Mind <this>."]), Warnings([])]),
            Section("How", [Commands(["benchtool fit 'a b' --model x"])]),
            Section("Numbers", [Table("Some.", ("name", "value"), [("a", "1")])]),
        ],
        simulated=True,
        highlights={"K_b": "1.97 ± 0.02"},
    )


def test_the_page_holds_what_it_was_given_with_markup_quoted():
    page = render_report(report())
    for text in (
        "A plate &lt;sweep&gt; &amp; its fit",
        "Thrust &lt; 30 N &amp; more.",
        "<dt>air density</dt><dd>1.19 kg/m³</dd>",
        "Mind &lt;this&gt;.",
        "benchtool fit &#39;a b&#39; --model x",
        "<b>Figure 2.</b> Second.",
        "<b>Table 1.</b> Some.",
        "1.97 ± 0.02",
    ):
        assert text in page
    assert page.count("<svg") == 2
    assert page.count('class="warnings"') == 1


def test_the_page_shows_bidi_and_control_characters_escaped():
    page = render_report(replace(report(), title="pquad\u202egnp", summary="a\x1b[2J"))
    assert "pquad\\u202egnp" in page
    assert "a\\x1b[2J" in page
    assert not {"\u202e", "\x1b"} & {*page}
    assert 'aria-label="First."' in page


def test_simulated_data_is_said_at_the_top():
    page = render_report(report())
    assert page.index("<strong>SIMULATED</strong>") < page.index("<h1>")
    physical = replace(report(), simulated=False, sections=())
    assert "SIMULATED" not in render_report(physical)


def test_a_row_of_the_wrong_length_is_refused():
    with pytest.raises(InputError, match=r"'Some\.': row with 1 cells"):
        Table("Some.", ("name", "value"), [("a",)])


@pytest.mark.parametrize(
    ("value", "sd", "text"),
    [
        (1.9741, 0.0213, "1.974 ± 0.021"),
        (1.2003e-5, 8.6e-9, "(1.20030 ± 0.00086)·10⁻⁵"),
        (-2.0, 0.0996, "−2.00 ± 0.10"),
        (20412.3, 118.0, "20412 ± 118"),
        (1.2e-5, float("nan"), "1.2·10⁻⁵"),
        (0.12, float("nan"), "0.12"),
        (0.0, 0.0, "0.0000 ± 0.0000"),
    ],
)
def test_numbers_have_the_digits_that_their_sd_allows(value, sd, text):
    assert value_with_sd(value, sd) == text
