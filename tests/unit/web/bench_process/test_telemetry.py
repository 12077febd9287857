from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from benchtool.core.channel import Channel
from benchtool.core.rig_file import load_rig_by_name
from benchtool.data.derived import measurement_context
from benchtool.web.bench_process.publisher import (
    HEADER_LENGTH,
    Decimator,
    frame_extremes,
    merge_frames,
)
from benchtool.web.bench_process.telemetry import limit_shares, live_values

values = arrays(
    float, st.tuples(st.integers(1, 30), st.just(3)),
    elements=st.one_of(st.just(float("nan")), st.floats(-1e6, 1e6, width=32)),
)  # fmt: skip


@given(values, st.integers(0, 30), st.integers(0, 30))
def test_no_extreme_is_missed_however_the_stream_is_cut(samples, first, second):
    decimator = Decimator(7, 3)
    frames = []
    for part in np.split(samples, sorted({min(first, len(samples)), min(second, len(samples))})):
        decimator.add(part)
        frames.append(decimator.pop_frame(len(frames)))
    merged = frames[0]
    for frame in frames[1:]:
        merged = merge_frames(merged, frame)
    low, high = frame_extremes(merged)
    for column in range(3):
        present = samples[:, column][~np.isnan(samples[:, column])]
        if len(present):
            assert (low[column], high[column]) == (present.min(), present.max())
        else:
            assert np.isnan(low[column])
            assert np.isnan(high[column])
    assert np.frombuffer(merged, "<f4")[2] == len(samples)


def test_a_frame_says_session_time_and_count():
    decimator = Decimator(2, 1)
    decimator.add(np.array([[1.0], [3.0], [2.0]]))
    np.testing.assert_allclose(
        np.frombuffer(decimator.pop_frame(1.5), "<f4"), [2.0, 1.5, 3.0, 1.0, 3.0]
    )
    empty = np.frombuffer(decimator.pop_frame(2.0), "<f4")
    assert empty[:HEADER_LENGTH].tolist() == [2.0, 2.0, 0.0]
    assert np.isnan(empty[HEADER_LENGTH:]).all()


def test_frames_of_two_sessions_are_not_joined():
    old, new = Decimator(1, 2), Decimator(2, 2)
    old.add(np.full((1, 2), 9.0))
    new.add(np.full((1, 2), 1.0))
    newer = new.pop_frame(0.1)
    assert merge_frames(old.pop_frame(50.0), newer) == newer


LIMITS = load_rig_by_name("pquad").limits
NAMES = ("pwm1_us", "rpm1", "rpm2", "thrust_N", "voltage_V", "current_A")


def test_the_reading_that_is_nearest_counts():
    low = np.array([1000.0, 0.0, 0.0, -30.0, 10.0, 0.0])
    high = np.array([1000.0, 900.0, 4900.0, 2.0, 11.0, np.nan])
    shares = limit_shares(NAMES, low, high, (1200.0, 1300.0), LIMITS)
    by_name = {share.name: share for share in shares}
    assert list(by_name) == ["thrust, N", "speed, rpm", "min. voltage, V", "pulse width, us"]
    assert by_name["speed, rpm"].share == pytest.approx(4900.0 / LIMITS.rpm)
    assert by_name["thrust, N"].value == 30.0
    assert by_name["min. voltage, V"].share == pytest.approx(LIMITS.voltage_min_V / 10.0)
    assert by_name["pulse width, us"].value == 1300.0


def test_nothing_is_near_where_nothing_came():
    missing = np.full(len(NAMES), np.nan)
    assert limit_shares(NAMES, missing, missing, (), LIMITS) == ()


def test_power_and_efficiency_follow_from_means_while_motors_turn():
    channels = tuple(
        Channel(name, unit)
        for name, unit in (("rpm1", "rpm"), ("thrust_N", "N"), ("torque_Nm", "N m"),
                           ("voltage_V", "V"), ("current_A", "A"))
    )  # fmt: skip
    nan = float("nan")
    samples = np.array([[6000.0, 3.0, 0.05, 11.0, 5.0], [6000.0, 5.0, 0.07, nan, 7.0]])
    context = measurement_context(rig=load_rig_by_name("pquad_single"))
    live = live_values(channels, samples, context, is_driven=True)
    values = {value.name: (value.value, value.unit) for value in live}
    assert values["thrust"] == (4.0, "N")
    assert values["electrical power"] == (pytest.approx(11.0 * 6.0), "W")
    shaft_W = 0.06 * 6000.0 * 2.0 * np.pi / 60.0
    assert values["mechanical power"] == (pytest.approx(shaft_W), "W")
    grams = 4.0 / 9.80665 * 1000.0 / 66.0
    assert values["overall efficiency"] == (pytest.approx(grams), "gf/W")
    assert values["motor and ESC efficiency"] == (pytest.approx(shaft_W / 66.0), "1")
    # At zero throttle only thrust is reported; without samples nothing is.
    live = live_values(channels, samples, context, is_driven=False)
    assert [value.name for value in live] == ["thrust"]
    assert live_values(channels, samples[:0], context, is_driven=True) == ()
