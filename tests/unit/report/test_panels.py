"""Parts of figures: thinned signals, ticks, a run's panels."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from benchtool.core.channel import Channel
from benchtool.core.recording import Recording
from benchtool.report.panels import broken_line, envelope, spans
from benchtool.report.sweep.samples import draw_samples


def test_an_envelope_keeps_every_spike(rng: np.random.Generator) -> None:
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


def test_a_short_signal_is_drawn_as_it_is_and_breaks_where_it_is_blank() -> None:
    time_s, values = np.arange(5.0), np.array([1.0, np.nan, 3.0, 4.0, 5.0])
    shown_s, shown = envelope(time_s, values)
    assert shown_s.tolist() == [0.0, 2.0, 3.0, 4.0]
    assert shown.tolist() == [1.0, 3.0, 4.0, 5.0]
    axes = Figure().subplots()
    broken_line(axes, time_s, values)
    drawn = np.asarray(axes.lines[0].get_ydata())
    np.testing.assert_array_equal(drawn, [1.0, np.nan, 3.0, 4.0, 5.0, np.nan])


def test_spans_are_the_stretches_that_are_inside() -> None:
    inside = np.array([True, False, True, True, False, True])
    assert spans(np.arange(6.0), inside) == [(0.0, 1.0), (2.0, 4.0), (5.0, 5.0)]


def run(rotors: int, last_s: float = 100.0) -> Recording:
    """Make samples of 200 rows that rise with time; the plate was never read."""
    time_s = np.linspace(0.0, last_s, 200)
    columns = [(Channel("time_s", "s"), time_s), (Channel("thrust_N", "N"), time_s)]
    for rotor in range(1, rotors + 1):
        columns.append((Channel(f"rpm{rotor}", "rpm"), time_s))
        columns.append((Channel(f"pwm{rotor}_us", "pwm_us"), 1000.0 + time_s))
    return Recording.from_columns(columns)


def test_a_run_has_a_panel_for_each_signal_with_its_windows_shaded() -> None:
    figure = Figure()
    windows = [(10.0, 20.0, "measure"), (30.0, 40.0, "anchor"), (50.0, 60.0, "measure")]
    plate = (Channel("plate_z_m", "m"), np.full(200, 0.24))
    draw_samples(figure, run(4).with_column(*plate), windows, radius_m=0.12)
    thrust, speed, pwm, distance = figure.axes
    labels = ["thrust [N]", "rotor speed\n[rpm]", "pwm [µs]", "plate [mm]"]
    assert [axes.get_ylabel() for axes in figure.axes] == labels
    for axes in figure.axes:
        assert [len(shade.get_paths()) for shade in axes.collections] == [2, 1]
    assert len(speed.lines) == len(pwm.lines) == 4
    assert max(np.asarray(speed.lines[0].get_ydata())) == pytest.approx(100.0)
    legends = [axes.get_legend() for axes in (thrust, speed)]
    words = [[text.get_text() for text in legend.get_texts()] for legend in legends if legend]
    assert words == [["measure", "anchor"], ["rotor 1", "2", "3", "4"]]
    assert [axis.get_ylabel() for axis in distance.child_axes] == ["$z/R$ [–]"]
    assert distance.get_xlabel() == "time [s]"
