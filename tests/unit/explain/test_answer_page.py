"""The page of an answer: what a reader finds in it, for every kind of verdict."""

from __future__ import annotations

import pytest

from benchtool.explain.answer_figures import answer_figures
from benchtool.explain.answer_page import answer_page
from benchtool.explain.verdict import KINDS, Kind
from benchtool.report.html import render_report
from tests.unit.explain.hand_made import answer


@pytest.mark.parametrize("kind", KINDS)
def test_a_page_says_the_verdict_first_and_what_was_not_judged(kind: Kind) -> None:
    given = answer(kind)
    text = render_report(answer_page(given, answer_figures(given)))
    assert given.verdict.sentence.split(",")[0] in text
    places = [text.index(f">{title}</h2>") for title in ("Where", "Which", "The gap")]
    assert places == sorted(places)
    assert "would have to be 4.2 tolerances large to show" in text
    assert ("What to record next" in text) == (kind in ("class", "unknown"))


def test_several_effects_have_a_figure_each() -> None:
    given = answer("several")
    figures = answer_figures(given)
    assert {"which_coulomb_friction", "which_cog_offset"} <= set(figures)
    assert "which" not in figures
    text = render_report(answer_page(given, figures))
    assert "What may stand in the place of cog_offset" in text
