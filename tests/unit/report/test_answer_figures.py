"""Figures of an answer: which parts are shown, what stands in each."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from benchtool.report.figure import drawn
from tests.unit.explain.hand_made import answer


def test_gaps_are_drawn_in_noise_floors_with_the_band_of_pure_noise():
    given = answer()
    (axes,) = drawn("answer", given, ["gap"])["gap"].figure.axes
    gaps = given.verdict.gaps
    widths = [size / gap.floor for gap in gaps for size in (gap.before, gap.after)]
    assert_allclose([patch.get_width() for patch in axes.patches], widths)  # type: ignore[attr-defined]
    band = axes.collections[0].get_paths()[0].vertices[:, 0]
    assert_allclose(
        [band.min(), band.max()], [gaps[0].floor_low, gaps[0].floor_high] / np.array(gaps[0].floor)
    )


def test_parameters_stand_beside_the_band_that_would_not_matter():
    given = answer("several")
    (axes,) = drawn("answer", given, ["parameters"])["parameters"].figure.axes
    assert axes.patches[0].get_gid() == "tolerance"
    points = [np.asarray(bars.lines[0].get_xdata()).item() for bars in axes.containers]  # type: ignore[attr-defined]
    found = [item for effect in given.verdict.effects for item in effect.parameters]
    assert_allclose(points, [(item.value - item.neutral) / item.tolerance for item in found])
