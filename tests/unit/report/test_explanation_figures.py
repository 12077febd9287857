"""Figures of an explanation: overlay, gap, where, probabilities, sizes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchtool.core.errors import InputError
from benchtool.report.answer.disagreement import MOST_REGIMES, StageSizes, disagreement_figure
from benchtool.report.answer.gap import GapBar, gap_figure
from benchtool.report.answer.probabilities import probability_figure
from benchtool.report.files import figure_bytes
from benchtool.report.flight.effect_sizes import EffectSize, effect_size_figure
from benchtool.report.sweep.overlay import AFTER, BEFORE, Curves, overlay_figure, worst_stretch


def curves(*, as_lines: bool = True, changed: bool = True) -> Curves:
    at = np.arange(0.0, 6.0, 0.01)
    at[::100] = np.nan
    measured = np.sin(np.nan_to_num(at))
    off = np.where((at > 3.0) & (at < 4.0), 0.5, 0.1)
    return Curves(
        label="pitch [deg]", place="time [s]", at=at, measured=measured, before=measured - off,
        after=measured - 0.02, floor=0.05, as_lines=as_lines, changed=changed,
    )  # fmt: skip


def bar(**changes: object) -> GapBar:
    given = {
        "channel": "pitch", "text": "0.9 → 0.3 deg", "before": 0.9, "after": 0.3,
        "before_range": (0.8, 1.0), "after_range": (0.27, 0.34), "floor": 0.3,
        "floor_range": (0.26, 0.36), "as_given": 1.2,
    }  # fmt: skip
    return GapBar(**{**given, **changes})  # type: ignore[arg-type]


def test_the_closer_look_is_at_the_stretch_where_the_old_model_is_worst() -> None:
    assert_allclose(worst_stretch(curves()), (3.01, 3.99))
    figure = overlay_figure(curves(), title="Pitch", simulated=True)
    assert_allclose(figure.axes[3].get_xlim(), (3.01, 3.99))
    low, high = figure.axes[1].get_ylim()
    assert low < np.sin(3.99) - 0.5
    assert high < 0.3  # fills its own height, not that of the whole recording


def test_an_overlay_draws_measurement_both_models_and_what_each_leaves() -> None:
    figure = overlay_figure(curves(), title="Pitch", simulated=False)
    values, _, residuals, _ = figure.axes
    assert [line.get_color() for line in values.lines][1:] == [BEFORE, AFTER]
    drawn = next(line for line in residuals.lines if line.get_color() == AFTER)
    assert_allclose(np.asarray(drawn.get_ydata(), float), 0.02)
    assert residuals.patches[0].get_gid() == "noise-floor"
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "measured", "simulated, old model", "simulated, new model",
    ]  # fmt: skip


def test_an_unchanged_model_is_drawn_once_and_measured_points_stand_by_themselves() -> None:
    figure = overlay_figure(
        curves(as_lines=False, changed=False), title="Thrust", simulated=False
    )  # fmt: skip
    assert len(figure.axes) == 2
    assert [line.get_linestyle() for line in figure.axes[0].lines] == ["None", "-"]


def test_gaps_are_drawn_in_noise_floors_with_the_band_of_pure_noise() -> None:
    figure = gap_figure([bar(), bar(channel="rpm", changed=False)], title="Gap", simulated=False)
    (axes,) = figure.axes
    assert_allclose([patch.get_width() for patch in axes.patches], [3.0, 1.0, 3.0])  # type: ignore[attr-defined]
    band = axes.collections[0].get_paths()[0].vertices
    assert_allclose([np.min(band[:, 0]), np.max(band[:, 0])], [0.26 / 0.3, 1.2])
    assert axes.get_xscale() == "linear"
    assert "0.9 → 0.3 deg" in {text.get_text() for text in axes.texts}


def test_a_gap_of_many_floors_gets_a_logarithmic_axis() -> None:
    figure = gap_figure([bar(before=9.0, before_range=(8.0, 10.0))], title="Gap", simulated=False)
    assert figure.axes[0].get_xscale() == "log"
    with pytest.raises(InputError, match="at least one channel"):
        gap_figure([], title="Gap", simulated=False)


def test_where_shows_first_what_the_addition_mended_and_marks_the_answer() -> None:
    before = {f"part {number}": 1.0 + number for number in range(12)}
    stage = StageSizes(
        stage="hinge", before=before, after=dict.fromkeys(before, 1.0), marked="part 11"
    )
    (axes,) = disagreement_figure([stage], title="Where", simulated=False).axes
    labels = axes.get_yticklabels()
    assert len(labels) == MOST_REGIMES
    assert labels[0].get_text() == "part 11"
    assert labels[0].get_fontweight() == "bold"
    assert labels[1].get_fontweight() != "bold"
    quiet = replace(stage, marked="part 0")
    (axes,) = disagreement_figure([quiet], title="Where", simulated=False).axes
    assert axes.get_yticklabels()[-1].get_text() == "part 0"
    # A part that stays bad has not to do with what was added.
    stubborn = replace(stage, after=stage.after | {"part 11": 12.0})
    (axes,) = disagreement_figure([stubborn], title="Where", simulated=False).axes
    assert axes.get_yticklabels()[0].get_text() == "part 10"
    with pytest.raises(InputError, match="at least one stage"):
        disagreement_figure([], title="Where", simulated=False)


def test_probabilities_keep_none_and_unknown_and_sum_the_rest() -> None:
    named = {f"effect {number}": 0.9 / 1.5**number for number in range(1, 14)}
    (axes,) = probability_figure(
        {**named, "none": 1e-9, "unknown": 1e-5}, {"effect 1"}, title="Which", simulated=False
    ).axes
    labels = [label.get_text() for label in axes.get_yticklabels()]
    assert labels[0] == "effect 1"
    assert labels[-3:] == ["none", "unknown", "5 others together"]
    assert [text.get_text() for text in axes.texts][-3:-1] == ["below 0.1 %", "below 0.1 %"]


def test_sizes_stand_beside_the_band_that_would_not_matter() -> None:
    sizes = [
        EffectSize(label="friction", text="0.02 N m", value=10.0, low=9.0, high=11.0),
        EffectSize(label="offset", text="−2 mm", value=-3.0, low=-3.5, high=-2.5),
    ]
    figure = effect_size_figure(sizes, title="What was found", simulated=True)
    (axes,) = figure.axes
    assert axes.patches[0].get_gid() == "tolerance"
    assert axes.get_xlim()[0] < -3.5
    assert axes.get_xlim()[1] > 11.0
    assert figure_bytes(figure, "svg") == figure_bytes(figure, "svg")
