"""Figures of a run and of a calibration."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.channel import Channel
from benchtool.core.errors import InputError
from benchtool.core.recording import Recording
from benchtool.report.flight.envelope import envelope
from benchtool.report.sweep.calibration import CalibrationPoints, calibration_figure
from benchtool.report.sweep.sweep import PointWindow, SweepTraces, sweep_figure


def traces(n: int = 200, rotors: int = 4, last_s: float = 100.0) -> SweepTraces:
    time_s = np.linspace(0.0, last_s, n)
    rows = np.tile(time_s, (rotors, 1))
    return SweepTraces(time_s, time_s, rows, 1000.0 + rows, np.full(n, 0.24))


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


def test_a_short_signal_is_kept_as_it_is() -> None:
    time_s, values = np.arange(5.0), np.array([1.0, np.nan, 3.0, 4.0, 5.0])
    kept_s, kept = envelope(time_s, values)
    assert kept_s.tolist() == [0.0, 2.0, 3.0, 4.0]
    assert kept.tolist() == [1.0, 3.0, 4.0, 5.0]


def test_a_run_has_four_panels_with_its_windows_shaded() -> None:
    windows = [PointWindow(10, 20), PointWindow(30, 40, "anchor"), PointWindow(50, 60)]
    figure = sweep_figure(traces(), windows, title="Run", simulated=True, radius_m=0.12)
    thrust, speed, pwm, plate = figure.axes
    assert [axes.get_ylabel() for axes in (thrust, pwm, plate)] == [
        "thrust [N]",
        "pwm [µs]",
        "plate [mm]",
    ]
    for axes in (thrust, speed, pwm, plate):
        assert [len(shade.get_paths()) for shade in axes.collections] == [2, 1]
    assert len(speed.lines) == len(pwm.lines) == 4
    assert max(np.asarray(speed.lines[0].get_ydata())) == pytest.approx(100.0 * 60 / (2 * np.pi))
    kinds, rotors = thrust.get_legend(), speed.get_legend()
    assert kinds is not None
    assert rotors is not None
    assert [text.get_text() for text in kinds.get_texts()] == ["measure", "anchor"]
    assert [text.get_text() for text in rotors.get_texts()] == ["rotor 1", "2", "3", "4"]
    assert [axis.get_ylabel() for axis in plate.child_axes] == ["$z/R$ [–]"]
    assert plate.get_xlabel() == "time [s]"


def test_a_long_run_is_drawn_in_minutes_and_one_rotor_needs_no_legend() -> None:
    figure = sweep_figure(traces(rotors=1, last_s=1800.0), title="Run", simulated=False)
    assert figure.axes[3].get_xlabel() == "time [min]"
    assert figure.axes[3].get_xlim()[1] == pytest.approx(30.0)
    assert all(axes.get_legend() is None for axes in figure.axes)


def test_traces_are_taken_from_a_recording_by_its_channels() -> None:
    n = 6
    recording = Recording.from_columns(
        [
            (Channel("time_s", "s"), np.arange(n, dtype=float)),
            (Channel("rpm1", "rpm"), np.full(n, 60.0)),
            (Channel("rpm2", "rpm"), np.full(n, 120.0)),
            (Channel("pwm1_us", "pwm_us"), np.full(n, 1500.0)),
            (Channel("thrust_N", "N"), np.array([1.0, np.nan] * 3)),
        ]
    )
    found = SweepTraces.from_recording(recording)
    assert found.speed_rad_s.shape == (2, n)
    assert found.speed_rad_s[1] == pytest.approx(np.full(n, 4.0 * np.pi))
    assert found.pwm_us.shape == (1, n)
    assert np.isnan(found.plate_z_m).all()
    figure = sweep_figure(found, title="Run", simulated=True)
    assert len(np.asarray(figure.axes[0].lines[0].get_xdata())) == 3
    # A plate that was never read has no panel.
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == ["thrust [N]", "rotor speed\n[rpm]", "pwm [µs]"]


def test_traces_of_different_length_are_refused() -> None:
    good = traces()
    with pytest.raises(InputError, match=r"pwm_us needs shape \(rotors, 200\).*\(4, 3\)"):
        SweepTraces(good.time_s, good.thrust_N, good.speed_rad_s, np.ones((4, 3)), good.plate_z_m)
    with pytest.raises(InputError, match=r"plate_z_m needs shape \(200,\)"):
        SweepTraces(good.time_s, good.thrust_N, good.speed_rad_s, good.pwm_us, np.ones(3))


def test_a_calibration_shows_both_ways() -> None:
    force_N = np.array([0.0, 5.0, 10.0, 5.0, 0.0])
    loading = np.array([True, True, True, False, False])
    read_N = force_N + np.array([0.0, 0.001, 0.0, 0.003, 0.001])
    points = CalibrationPoints(force_N, 1000.0 * read_N, read_N, loading)
    figure = calibration_figure(points, title="Calibration", simulated=False)
    line, left = figure.axes
    legend = line.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == [
        "line",
        "masses added",
        "masses taken off",
    ]
    up, down = left.lines[:2]
    assert np.asarray(up.get_ydata()) == pytest.approx([0.0, 1.0, 0.0])
    assert np.asarray(down.get_ydata()) == pytest.approx([3.0, 1.0])
    with pytest.raises(InputError, match=r"a calibration figure .*counts \(2,\)"):
        CalibrationPoints(force_N, force_N[:2], read_N, loading)
