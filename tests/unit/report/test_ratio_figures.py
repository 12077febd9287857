"""Ratio figures: every point with its bar, every curve where it is valid."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure

from benchtool.report.ratio import Curve, RatioPoints, draw_ratio

Z = np.linspace(0.3, 6.0, 58)
FACTOR = 1.0 / (1.0 - (1.0 / (4.0 * Z)) ** 2)
AT = np.array([0.4, 0.5, 1.0, 2.0, 4.0])


def points() -> RatioPoints:
    ratio = 1.0 / (1.0 - (1.0 / (4.0 * AT)) ** 2)
    return RatioPoints(AT, ratio, np.full(AT.size, 0.01), "rotor")


def drawn(*series: RatioPoints, curves: tuple[Curve, ...] = ()) -> Axes:
    figure = Figure()
    draw_ratio(figure, series, curves, "equal_pwm")
    assert len(figure.axes) == 1
    return figure.axes[0]


def error_bars(axes: Axes) -> list[ErrorbarContainer]:
    return [item for item in axes.containers if isinstance(item, ErrorbarContainer)]


def test_every_point_has_its_bar_of_one_sd():
    (bars,) = error_bars(drawn(points()))
    line, _, (stems,) = bars.lines
    assert np.array_equal(line.get_xdata(), AT)
    lengths = [segment[1, 1] - segment[0, 1] for segment in stems.get_segments()]
    assert lengths == pytest.approx([0.02] * AT.size)


def test_one_repeat_is_a_point_without_a_bar():
    sd = np.array([0.01, np.nan, 0.01, 0.01, 0.01])
    axes = drawn(RatioPoints(AT, np.linspace(1.4, 1.0, 5), sd, "rotor"))
    (bars,) = error_bars(axes)
    finite = [np.isfinite(s).all() for s in bars.lines[2][0].get_segments() if len(s)]
    assert sum(finite) == 4
    assert len(bars.lines[0].get_xdata()) == 5
    assert np.isfinite(axes.get_ylim()).all()


def test_curves_stop_at_the_validity_limit_which_is_hatched():
    axes = drawn(curves=(Curve(Z, FACTOR, "PFI"),))
    (line,) = [item for item in axes.lines if item.get_label() == "PFI"]
    assert min(np.asarray(line.get_xdata())) >= 0.5
    (hatched,) = [patch for patch in axes.patches if patch.get_hatch()]
    assert hatched.get_extents().transformed(axes.transData.inverted()).x1 == pytest.approx(0.5)
    low, high = axes.get_ylim()
    assert low < 1.0
    assert 1.30 < high < 1.40
