"""The figures of a fit: what is drawn is what the fit found."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.container import ErrorbarContainer

from benchtool.report.figure import drawn
from benchtool.report.files import figure_bytes
from benchtool.report.fit.residuals import expected_runs, judge_runs, runs_of_sign, standardised
from tests.contracts.figure_subjects import fit, sampled_fit


def test_runs_are_counted_and_judged() -> None:
    values = np.array([1.0, 2.0, -1.0, -2.0, -3.0, 0.5])
    assert runs_of_sign(values).tolist() == [2, -3, 1]
    # Three above, three below: 1 + 2*3*3/6 and 18 (18 - 6) / (36 * 5).
    assert expected_runs(values) == pytest.approx((4.0, np.sqrt(1.2)))
    assert judge_runs(3, 4.0, np.sqrt(1.2)) == "as independent residuals show"
    few = np.repeat([1.0, -1.0], 20)
    assert judge_runs(2, *expected_runs(few)).startswith("too few")
    assert judge_runs(40, *expected_runs(few)).startswith("too many")
    assert judge_runs(1, *expected_runs(np.ones(5))) == "as independent residuals show"
    assert runs_of_sign(np.empty(0)).tolist() == []


def test_the_expected_runs_are_those_of_independent_signs(rng: np.random.Generator) -> None:
    signs = np.repeat([1.0, -1.0], [12, 18])
    counts = [len(runs_of_sign(rng.permutation(signs))) for _ in range(400)]
    mean, sd = expected_runs(signs)
    assert np.mean(counts) == pytest.approx(mean, abs=4.0 * sd / 20.0)
    assert np.std(counts) == pytest.approx(sd, rel=0.15)


def test_residuals_are_drawn_four_ways_in_the_order_measured() -> None:
    found = fit("quad")
    distance, histogram, order, runs = drawn("fit", found, ["residuals"])["residuals"].figure.axes
    values = standardised(found)
    (dots,) = [line for line in distance.lines if line.get_gid() == "residuals"]
    assert np.array_equal(np.asarray(dots.get_ydata()), values)
    in_time = values[np.argsort(found.data.conditions.time_s[found.data.rows], kind="stable")]
    assert np.array_equal(np.asarray(order.lines[1].get_ydata()), in_time)
    area = sum(patch.get_height() * patch.get_width() for patch in histogram.patches)  # type: ignore[attr-defined]
    assert area == pytest.approx(1.0)
    assert f"{len(runs_of_sign(in_time))} runs" in runs.get_title(loc="left")


def test_thrust_is_drawn_over_rpm_with_the_residuals_below() -> None:
    found = fit("quad")
    above, below = drawn("fit", found, ["thrust"])["thrust"].figure.axes
    bars = [item for item in above.containers if isinstance(item, ErrorbarContainer)]
    left = [item for item in below.containers if isinstance(item, ErrorbarContainer)]
    assert [bar.get_label() for bar in bars][-1] == "out of ground effect"
    measured = np.concatenate([np.asarray(bar.lines[0].get_ydata()) for bar in bars])
    rest = np.concatenate([np.asarray(bar.lines[0].get_ydata()) for bar in left])
    predicted = found.fitted.thrust_N(found.data.conditions)
    used = found.data.used
    assert sorted(measured) == pytest.approx(sorted(found.data.observed[used]))
    assert sorted(rest) == pytest.approx(sorted((found.data.observed - predicted)[used]))


def test_areas_are_set_against_the_straight_line() -> None:
    found = fit("partial_area")
    share, departure = drawn("fit", found, ["area"])["area"].figure.axes
    fitted = np.asarray(share.lines[-1].get_ydata())
    at = np.asarray(share.lines[-1].get_xdata())
    assert np.all(np.diff(at) > 0.0)
    assert np.asarray(departure.lines[-1].get_ydata()) == pytest.approx(fitted - at)
    factors = [item.value for item in found.results[0].derived if ".factor_" in item.name]
    assert set(np.round(factors, 9)) <= set(np.round(fitted, 9))


def test_a_corner_marks_the_least_squares_and_names_its_axes() -> None:
    found = sampled_fit()
    figure = drawn("fit", found, ["corner"])["corner"].figure
    n = len(found.results[0].estimates)
    assert len(figure.axes) == n * n
    assert "±" in figure.axes[0].get_title(loc="center")
    labels = [axes.get_xlabel() for axes in figure.axes[-n:]]
    assert [label.split("\n")[-1].split(" [")[0] for label in labels] == [
        item.name.rpartition(".")[2] for item in found.results[0].estimates
    ]
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()][1:] == ["least squares"]
    again = drawn("fit", found, ["corner"])["corner"].figure
    assert figure_bytes(figure) == figure_bytes(again)
