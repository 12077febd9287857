"""The page of an answer: what a reader finds in it, for every kind of verdict."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchtool.explain.engine.verdict import EVERYWHERE, KINDS, Kind, NotJudged, WhereShown
from benchtool.explain.next_steps import next_sentence
from benchtool.report.answer.figures import shown_regimes
from benchtool.report.answer.overlay import OVERLAY, overlay_caption
from benchtool.report.answer.page import answer_page, where_sentence
from benchtool.report.figure import drawn
from benchtool.report.html import render_report
from tests.unit.explain.hand_made import answer

TITLES = ("What now", "Where", "Which", "The gap")


@pytest.mark.parametrize("kind", KINDS)
def test_a_page_says_the_verdict_first_and_what_was_not_judged(kind: Kind) -> None:
    given = answer(kind)
    text = render_report(answer_page(given, drawn("answer", given)))
    assert given.verdict.sentence.split(",")[0] in text
    places = [text.index(f">{title}</h2>") for title in TITLES]
    assert places == sorted(places)
    assert "would have to be 4.2 tolerances large to show" in text
    assert ("Record next: " in text) == (kind in ("class", "unknown"))


def test_several_effects_have_a_figure_each() -> None:
    given = answer("several")
    figures = drawn("answer", given)
    assert {"which_coulomb_friction", "which_cog_offset"} <= set(figures)
    assert "which" not in figures
    text = render_report(answer_page(given, figures))
    assert "What may stand in the place of: Centre-of-gravity offset" in text


def test_where_shows_what_stands_above_noise_and_titles_name_effects() -> None:
    before = {"at rest": 0.9, "fast motion": 2.0, "plate in": 0.8, "everywhere": 1.2}
    assert shown_regimes(before, {}, "") == ["fast motion", "everywhere"]
    assert shown_regimes(before, {}, "plate in") == ["fast motion", "everywhere", "plate in"]
    assert shown_regimes(dict.fromkeys(before, 0.7), {}, "") == ["at rest"]
    given = answer("class")
    labels = [
        label.get_text()
        for name in ("which", "parameters")
        for label in drawn("answer", given)[name].figure.axes[0].get_yticklabels()
    ]
    assert labels[0] == "Coulomb friction"
    assert "Centre-of-gravity offset\nx_m" in labels
    assert not any("_friction" in label or "_offset" in label for label in labels)


def test_a_disagreement_without_a_place_of_its_own_reads_so() -> None:
    where = WhereShown(stage="hinge", regime=EVERYWHERE, size=1.06, share=1.0)
    given = answer("unknown")
    spread = replace(given.explanation, verdict=replace(given.verdict, where=where))
    assert where_sentence(replace(given, explanation=spread)) == (
        "The disagreement is at the hinge, spread over the whole of the recordings; "
        "residuals are 1.1 times the stated noise."
    )


def test_great_residuals_are_told_as_people_write_them() -> None:
    where = WhereShown(stage="hinge", regime=EVERYWHERE, size=249.6, share=1.0)
    given = answer("unknown")
    spread = replace(given.explanation, verdict=replace(given.verdict, where=where))
    assert "residuals are 250 times" in where_sentence(replace(given, explanation=spread))


def test_a_gap_above_noise_is_no_agreement() -> None:
    given = answer("none")
    gaps = [replace(gap, after=2.0 * gap.floor_high) for gap in given.verdict.gaps[:1]]
    apart = replace(given.explanation, verdict=replace(given.verdict, gaps=tuple(gaps)))
    text = where_sentence(replace(given, explanation=apart))
    assert "missed by more than noise: pitch by" in text
    assert "agrees" in where_sentence(given)


def test_what_weighs_on_the_verdict_stands_beside_it_and_spikes_are_explained() -> None:
    given = answer("effect")
    page = answer_page(given, drawn("answer", given))
    assert page.summary.startswith(given.verdict.sentence)
    assert page.summary.endswith("Mind what it rests on: " + given.remarks[0] + ".")
    assert "restarts every 1 s from the measured state" in render_report(page)
    assert overlay_caption(0.0) == OVERLAY


def test_a_stage_without_rows_of_its_own_is_marked_where_the_beam_moves() -> None:
    given = answer("effect")
    where = WhereShown(stage="rpm_to_thrust", regime="slow reversals", size=1.2, share=0.8)
    thrust = replace(given.explanation, verdict=replace(given.verdict, where=where))
    figure = drawn("answer", replace(given, explanation=thrust))["where"].figure
    marked = {
        (axes.get_title(loc="left"), label.get_text())
        for axes in figure.axes
        for label in axes.get_yticklabels()
        if label.get_fontweight() == "bold"
    }
    assert marked == {("hinge", "slow reversals")}


def test_silence_of_poor_data_says_how_little_it_means() -> None:
    given = answer("none")
    tried = dict.fromkeys({name.partition(".")[0] for name in given.verdict.tolerances})
    assert given.verdict.sentence.endswith(f"; 1 of {len(tried)} effects were not judged.")
    blind = {name: NotJudged.below(500.0) for name in list(tried)[:-2]}
    poor = replace(
        given,
        explanation=replace(given.explanation, verdict=replace(given.verdict, not_judged=blind)),
    )
    assert poor.verdict.sentence.startswith(f"This data can show only 2 of {len(tried)} effects")
    assert "the schedule identify" in next_sentence(poor)
    assert next_sentence(given) == ""
    assert "the schedule identify" in render_report(answer_page(poor, drawn("answer", poor)))
