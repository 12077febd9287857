"""Thrust, residuals, runs, corners, chains and areas: what is in the picture."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.container import ErrorbarContainer
from matplotlib.patches import Rectangle

from benchtool.core.errors import InputError
from benchtool.report.files import figure_bytes
from benchtool.report.fit.chains import Chains, chain_figure
from benchtool.report.fit.corner import corner_figure
from benchtool.report.fit.residuals import Residuals, residual_figure
from benchtool.report.runs import runs_of_sign
from benchtool.report.sweep.area import AreaPoints, area_figure
from benchtool.report.sweep.thrust import ThrustSeries, thrust_figure

SPEED = np.array([300.0, 450.0, 600.0])


def series(z_over_R: float, *, model: bool = True) -> ThrustSeries:
    thrust_N = 1.2e-5 * SPEED**2
    line = np.linspace(250.0, 650.0, 20) if model else np.empty(0)
    return ThrustSeries(
        z_over_R,
        SPEED,
        thrust_N + 0.01,
        np.full(3, 0.02),
        thrust_N if model else np.empty(0),
        line,
        1.2e-5 * line**2,
    )


def test_thrust_is_drawn_over_rpm_with_the_residuals_below() -> None:
    figure = thrust_figure(
        [series(np.inf), series(2.0), series(0.5)], title="Thrust", simulated=True
    )
    above, below = figure.axes
    legend = above.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == [
        "$z/R$ = 0.5",
        "$z/R$ = 2",
        "out of ground effect",
    ]
    bars = [item for item in below.containers if isinstance(item, ErrorbarContainer)]
    assert len(bars) == 3
    assert np.asarray(bars[0].lines[0].get_xdata()) == pytest.approx(SPEED * 60 / (2 * np.pi))
    assert np.asarray(bars[0].lines[0].get_ydata()) == pytest.approx([0.01] * 3)
    assert below.get_xlabel() == "rotor speed [rpm]"
    assert above.get_ylabel() == "thrust [N]"


def test_thrust_without_a_model_has_no_residuals() -> None:
    figure = thrust_figure([series(1.0, model=False)], title="Thrust", simulated=False)
    assert len(figure.axes) == 1
    with pytest.raises(InputError, match=r"z/R\$ = 1 .*predicted_N \(2,\)"):
        ThrustSeries(1.0, SPEED, SPEED, SPEED, SPEED[:2])


def test_runs_are_counted_and_judged() -> None:
    runs = runs_of_sign(np.array([1.0, 2.0, -1.0, -2.0, -3.0, 0.5]))
    assert runs.count == 3
    assert runs.lengths.tolist() == [2, 3, 1]
    assert runs.signs.tolist() == [1, -1, 1]
    # Three above, three below: 1 + 2*3*3/6 and 18 (18 - 6) / (36 * 5).
    assert runs.expected == pytest.approx(4.0)
    assert runs.sd == pytest.approx(np.sqrt(1.2))
    assert "independent" in runs.verdict
    assert "too few" in runs_of_sign(np.repeat([1.0, -1.0], 20)).verdict
    assert "too many" in runs_of_sign(np.tile([1.0, -1.0], 20)).verdict
    assert runs_of_sign(np.ones(5)).count == 1
    assert runs_of_sign(np.empty(0)).count == 0


def test_the_expected_runs_are_those_of_independent_signs(rng: np.random.Generator) -> None:
    counts = []
    for _ in range(400):
        shuffled = rng.permutation(np.repeat([1.0, -1.0], [12, 18]))
        counts.append(runs_of_sign(shuffled).count)
    said = runs_of_sign(np.repeat([1.0, -1.0], [12, 18]))
    assert np.mean(counts) == pytest.approx(said.expected, abs=4.0 * said.sd / 20.0)
    assert np.std(counts) == pytest.approx(said.sd, rel=0.15)


def test_residuals_four_ways_in_the_order_measured(rng: np.random.Generator) -> None:
    z = np.tile([0.5, 1.0, 2.0, np.inf], 10)
    time_s = rng.permutation(40).astype(float)
    values = rng.normal(size=40)
    figure = residual_figure(Residuals(z, time_s, values), title="Residuals", simulated=True)
    distance, histogram, order, runs = figure.axes
    (dots,) = [line for line in distance.lines if line.get_gid() == "residuals"]
    assert len(dots.get_xdata()) == 40
    assert [label.get_text() for label in distance.get_xticklabels()][-1] == "OGE"
    assert len([c for c in distance.containers if isinstance(c, ErrorbarContainer)]) == 4
    shown = [line for line in order.lines if len(np.asarray(line.get_xdata())) == 40]
    assert np.array_equal(np.asarray(shown[0].get_ydata()), values[np.argsort(time_s)])
    counted = sum(
        patch.get_height() * patch.get_width()
        for patch in histogram.patches
        if isinstance(patch, Rectangle)
    )
    assert counted == pytest.approx(1.0)
    assert f"{runs_of_sign(values[np.argsort(time_s)]).count} runs" in runs.get_title(loc="left")


@pytest.mark.parametrize("n", [1, 2, 7])
def test_few_residuals_are_drawn_too(n: int) -> None:
    residuals = Residuals(np.full(n, np.inf), np.arange(n, dtype=float), np.linspace(-5, 9, n))
    figure = residual_figure(residuals, title="Residuals", simulated=False)
    assert len(figure.axes) == 4
    assert figure_bytes(figure)


def test_corner_plots_mark_truth_and_least_squares(rng: np.random.Generator) -> None:
    draws = rng.normal(size=(3000, 3)) * [1e-8, 1e-3, 0.1] + [1.2e-5, 0.12, 2.0]
    names = ["$k$ [N/(rad/s)²]", "$R$ [m]", "$K_b$ [–]"]
    marked = {"truth": [1.2e-5, 0.12, np.nan], "least squares": [1.2e-5, 0.1201, 2.3]}
    figure = corner_figure(draws, names, title="Corner", simulated=True, references=marked)
    assert len(figure.axes) == 9
    assert [axes.get_xlabel() for axes in figure.axes[6:]] == names
    assert "±" in figure.axes[0].get_title(loc="center")
    assert figure.axes[0].get_title(loc="center").endswith("10⁻⁵")
    assert figure.axes[8].get_xlim()[1] > 2.3
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()][1:] == ["truth", "least squares"]
    again = corner_figure(draws, names, title="Corner", simulated=True, references=marked)
    assert figure_bytes(figure) == figure_bytes(again)


def test_a_parameter_that_never_moves_still_has_a_corner() -> None:
    draws = np.column_stack([np.linspace(0.0, 1.0, 500), np.full(500, 2.0)])
    figure = corner_figure(draws, ["a", "b"], title="Corner", simulated=False)
    assert len(figure.axes) == 4


def test_corner_plots_refuse_what_they_cannot_draw() -> None:
    with pytest.raises(InputError, match=r"shape \(4, 10, 2\).*flattened"):
        corner_figure(np.zeros((4, 10, 2)), ["a", "b"], title="Corner", simulated=False)
    many = {str(number): [0.0, 0.0] for number in range(4)}
    with pytest.raises(InputError, match="at most 3 points, got 4"):
        corner_figure(
            np.zeros((10, 2)), ["a", "b"], title="Corner", simulated=False, references=many
        )


def test_chains_show_four_ensembles_and_their_convergence(rng: np.random.Generator) -> None:
    draws = rng.normal(size=(4, 1500, 20, 2))
    chains = Chains(["R", "K_b"], draws, np.array([1.003, 1.2]), np.array([41.0, 77.0]), 300)
    figure = chain_figure(chains, title="Chains", simulated=True)
    first, second = figure.axes
    assert "1.0030" in first.get_title(loc="left")
    assert "41 steps" in first.get_title(loc="left")
    assert "above" not in first.get_title(loc="left")
    assert "above 1.01" in second.get_title(loc="left")
    assert len({line.get_color() for line in first.lines}) == 4
    assert max(len(np.asarray(line.get_xdata())) for line in first.lines) <= 600
    legend = first.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == [
        f"ensemble {number}" for number in (1, 2, 3, 4)
    ]
    assert "left out" in second.get_xlabel()
    with pytest.raises(InputError, match=r"\(ensembles, steps, walkers, 1\)"):
        Chains(["R"], draws, np.ones(1), np.ones(1))
    with pytest.raises(InputError, match="one r_hat and one tau each"):
        Chains(["R", "K_b"], draws, np.ones(1), np.ones(2))


def test_areas_are_set_against_the_straight_line() -> None:
    at = np.array([0.75, 0.25, 0.5])
    measured = AreaPoints(at, at + 0.02, np.full(3, 0.01), "measured")
    factors = AreaPoints(at, at - 0.05, np.full(3, 0.01), "fitted")
    figure = area_figure([measured], factors, title="Area", simulated=True)
    share, departure = figure.axes
    legend = share.get_legend()
    assert legend is not None
    assert len(legend.get_texts()) == 3
    fitted = departure.lines[-1]
    assert np.asarray(fitted.get_xdata()).tolist() == [0.25, 0.5, 0.75]
    assert np.asarray(fitted.get_ydata()) == pytest.approx([-0.05] * 3)
    (bars,) = [c for c in departure.containers if isinstance(c, ErrorbarContainer)]
    assert np.asarray(bars.lines[0].get_ydata()) == pytest.approx([0.02] * 3)
    assert len(area_figure([measured], None, title="Area", simulated=True).axes) == 2
