"""Figures of fits and answers, panels, and style."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose

from benchtool.core.errors import WouldOverwrite
from benchtool.fit.statistics import expected_runs
from benchtool.report.figure import (
    SIMULATED,
    SIMULATED_GID,
    figure_bytes,
    look,
    new_figure,
    render_figures,
    save_figure,
)
from benchtool.report.fit.diagnostics import judge_runs, runs_of_sign
from benchtool.report.panels import broken_line, envelope
from tests.unit.explain.hand_made import answer


def test_runs_are_counted_and_judged():
    values = np.array([1.0, 2.0, -1.0, -2.0, -3.0, 0.5])
    assert runs_of_sign(values).tolist() == [2, -3, 1]
    # Three above, three below: 1 + 2*3*3/6 and 18 (18 - 6) / (36 * 5).
    assert expected_runs(values >= 0.0) == pytest.approx((4.0, np.sqrt(1.2)))
    assert judge_runs(3, 4.0, np.sqrt(1.2)) == "consistent with independent residuals"
    few = np.repeat([1.0, -1.0], 20)
    assert judge_runs(2, *expected_runs(few >= 0.0)).startswith("too few")
    assert judge_runs(40, *expected_runs(few >= 0.0)).startswith("too many")
    assert (
        judge_runs(1, *expected_runs(np.ones(5, bool))) == "consistent with independent residuals"
    )
    assert runs_of_sign(np.empty(0)).tolist() == []


def test_the_expected_runs_are_those_of_independent_signs(rng):
    signs = np.repeat([1.0, -1.0], [12, 18])
    counts = [len(runs_of_sign(rng.permutation(signs))) for _ in range(400)]
    mean, sd = expected_runs(signs >= 0.0)
    assert np.mean(counts) == pytest.approx(mean, abs=4.0 * sd / 20.0)
    assert np.std(counts) == pytest.approx(sd, rel=0.15)


def test_gaps_are_drawn_in_noise_floors_with_the_band_of_pure_noise():
    given = answer()
    (axes,) = render_figures("answer", given, ["gap"])["gap"].figure.axes
    gaps = given.gaps
    widths = [size / gap.floor for gap in gaps for size in (gap.before, gap.after)]
    assert_allclose([patch.get_width() for patch in axes.patches], widths)  # type: ignore[attr-defined]
    band = axes.collections[0].get_paths()[0].vertices[:, 0]
    assert_allclose(
        [band.min(), band.max()], [gaps[0].floor_low, gaps[0].floor_high] / np.array(gaps[0].floor)
    )


def test_parameters_stand_beside_the_band_that_would_not_matter():
    given = answer("several")
    (axes,) = render_figures("answer", given, ["parameters"])["parameters"].figure.axes
    assert axes.patches[0].get_gid() == "tolerance"
    points = [np.asarray(bars.lines[0].get_xdata()).item() for bars in axes.containers]  # type: ignore[attr-defined]
    found = [item for effect in given.effects for item in effect.parameters]
    assert_allclose(points, [(item.value - item.neutral) / item.tolerance for item in found])


def test_an_envelope_keeps_every_spike(rng):
    time_s = np.arange(100_000) / 200.0
    values = rng.normal(size=time_s.size)
    values[rng.integers(0, values.size, 50_000)] = np.nan
    values[77_777] = 31.0
    thin_s, thin = envelope(time_s, values, slots=500)
    assert thin.size <= 1002
    assert thin.max() == 31.0
    assert thin.min() == np.nanmin(values)
    assert np.all(np.diff(thin_s) > 0.0)
    assert np.isfinite(thin).all()


def test_a_short_signal_is_drawn_as_it_is_and_breaks_where_it_is_blank():
    time_s, values = np.arange(5.0), np.array([1.0, np.nan, 3.0, 4.0, 5.0])
    shown_s, shown = envelope(time_s, values)
    assert shown_s.tolist() == [0.0, 2.0, 3.0, 4.0]
    assert shown.tolist() == [1.0, 3.0, 4.0, 5.0]
    axes = Figure().subplots()
    broken_line(axes, time_s, values)
    drawn = np.asarray(axes.lines[0].get_ydata())
    np.testing.assert_array_equal(drawn, [1.0, np.nan, 3.0, 4.0, 5.0, np.nan])


@look()
def example(*, simulated: bool) -> Figure:
    figure = new_figure("Example", simulated=simulated, height_in=3.0)
    axes = figure.subplots()
    axes.plot([0.0, 1.0], [1.0, 2.0], label="line")
    axes.legend()
    return figure


@pytest.mark.parametrize("simulated", [True, False])
def test_the_stamp_is_on_simulated_figures_only(simulated):
    figure = example(simulated=simulated)
    stamps = [text for text in figure.texts if text.get_gid() == SIMULATED_GID]
    assert [text.get_text() for text in stamps] == ([SIMULATED] if simulated else [])
    svg = figure_bytes(figure, "svg").decode()
    assert (f'id="{SIMULATED_GID}"' in svg) is simulated


@pytest.mark.parametrize("file_format", ["svg", "png", "pdf"])
def test_the_same_figure_gives_the_same_bytes(file_format):
    one = figure_bytes(example(simulated=True), file_format)  # type: ignore[arg-type]
    other = figure_bytes(example(simulated=True), file_format)  # type: ignore[arg-type]
    assert one == other
    assert len(one) > 2000


def test_files_are_written_whole_and_not_overwritten_unasked(tmp_path):
    stem = tmp_path / "figures" / "run.1"
    paths = save_figure(example(simulated=True), stem, ("svg", "png", "pdf"))
    assert [path.name for path in paths] == ["run.1.svg", "run.1.png", "run.1.pdf"]
    assert paths[1].read_bytes().startswith(b"\x89PNG")
    assert paths[2].read_bytes().startswith(b"%PDF")
    paths[1].write_text("kept")
    with pytest.raises(WouldOverwrite, match=r"run\.1\.(svg|png|pdf)"):
        save_figure(example(simulated=True), stem)
    assert paths[1].read_text() == "kept"
    save_figure(example(simulated=True), stem, replace=True)
    assert paths[1].read_bytes().startswith(b"\x89PNG")
    assert len(list(stem.parent.iterdir())) == len(paths)
