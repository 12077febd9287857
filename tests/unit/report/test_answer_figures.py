"""Figures of an answer: which parts are shown, what stands in each."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from benchtool.report.answer.figures import (
    AFTER,
    BEFORE,
    MOST_REGIMES,
    shown_explanations,
    shown_regimes,
)
from benchtool.report.answer.overlay import worst_stretch
from benchtool.report.figure import drawn
from tests.unit.explain.hand_made import answer


def test_the_worst_stretch_is_between_two_breaks() -> None:
    at = np.arange(0.0, 6.0, 0.01)
    at[::100] = np.nan
    error = np.where((at > 3.0) & (at < 4.0), 0.5, 0.1)
    assert_allclose(worst_stretch(at, error), (3.01, 3.99))


def test_an_overlay_draws_measurement_both_models_and_what_each_leaves() -> None:
    figure = drawn("answer", answer(), ["overlay"])["overlay_theta_rad"].figure
    values, closer, residuals, below = figure.axes
    assert [line.get_color() for line in values.lines][1:] == [BEFORE, AFTER]
    assert residuals.patches[0].get_gid() == "noise-floor"
    assert closer.get_xlim() == below.get_xlim()
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "measured", "simulated, old model", "simulated, new model",
    ]  # fmt: skip


def test_gaps_are_drawn_in_noise_floors_with_the_band_of_pure_noise() -> None:
    given = answer()
    (axes,) = drawn("answer", given, ["gap"])["gap"].figure.axes
    gaps = given.verdict.gaps
    widths = [size / gap.floor for gap in gaps for size in (gap.before, gap.after)]
    assert_allclose([patch.get_width() for patch in axes.patches], widths)  # type: ignore[attr-defined]
    band = axes.collections[0].get_paths()[0].vertices[:, 0]
    assert_allclose(
        [band.min(), band.max()], [gaps[0].floor_low, gaps[0].floor_high] / np.array(gaps[0].floor)
    )


def test_where_shows_first_what_the_addition_reduced_and_always_the_answer() -> None:
    before = {f"part {number}": 1.0 + number for number in range(12)}
    after = dict.fromkeys(before, 1.0)
    shown = shown_regimes(before, after, "part 11")
    assert len(shown) == MOST_REGIMES
    assert shown[0] == "part 11"
    assert shown_regimes(before, after, "part 0")[-1] == "part 0"
    # A part that stays bad has not to do with what was added.
    assert shown_regimes(before, after | {"part 11": 12.0}, "")[0] == "part 10"


def test_probabilities_always_show_none_and_unknown_and_sum_the_rest() -> None:
    named = {f"effect {number}": 0.9 / 1.5**number for number in range(1, 14)}
    shown = list(shown_explanations({**named, "none": 1e-9, "unknown": 1e-5}))
    assert shown[0] == "effect 1"
    assert shown[-3:] == ["none", "unknown", "5 others together"]


def test_parameters_stand_beside_the_band_that_would_not_matter() -> None:
    given = answer("several")
    (axes,) = drawn("answer", given, ["parameters"])["parameters"].figure.axes
    assert axes.patches[0].get_gid() == "tolerance"
    points = [np.asarray(bars.lines[0].get_xdata()).item() for bars in axes.containers]  # type: ignore[attr-defined]
    found = [item for effect in given.verdict.effects for item in effect.parameters]
    assert_allclose(points, [(item.value - item.neutral) / item.tolerance for item in found])
