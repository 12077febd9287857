"""Parts of figures: thinned signals and broken lines."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from benchtool.report.panels import broken_line, envelope


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
