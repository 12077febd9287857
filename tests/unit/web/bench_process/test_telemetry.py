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
    extremes = np.frombuffer(merged, "<f4")[HEADER_LENGTH:].astype(float)
    low, high = extremes[::2], extremes[1::2]
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
    decimator.add(np.array([[1.0], [3.0], [2.0]]), lost=4)
    np.testing.assert_allclose(
        np.frombuffer(decimator.pop_frame(1.5), "<f4"), [2.0, 1.5, 3.0, 4.0, 1.0, 3.0]
    )
    empty = np.frombuffer(decimator.pop_frame(2.0), "<f4")
    assert empty[:HEADER_LENGTH].tolist() == [2.0, 2.0, 0.0, 0.0]
    assert np.isnan(empty[HEADER_LENGTH:]).all()


def test_frames_of_two_sessions_are_not_joined():
    old, new = Decimator(1, 2), Decimator(2, 2)
    old.add(np.full((1, 2), 9.0))
    new.add(np.full((1, 2), 1.0))
    newer = new.pop_frame(0.1)
    assert merge_frames(old.pop_frame(50.0), newer) == newer


RIG = load_rig_by_name("pquad")
NAMES = ("pwm1_us", "rpm1", "rpm2", "thrust_N", "voltage_V", "temperature_degC", "current_A")
CHANNELS = tuple(Channel(name, "1") for name in NAMES)


def test_the_reading_that_is_nearest_to_its_limit_counts():
    low = np.array([1000.0, 0.0, 0.0, -30.0, 10.0, 25.0, 0.0])
    high = np.array([1000.0, 900.0, 4900.0, 2.0, 11.0, 30.0, np.nan])
    idle = {"voltage_V": 16.0, "temperature_degC": 20.0}
    readings = np.array([low, (low + high) / 2.0, high])
    shares = limit_shares(CHANNELS, readings, (1200.0, 1300.0), RIG, idle)
    by_name = {share.name: share for share in shares}
    assert list(by_name) == ["thrust", "speed", "pulse", "voltage", "temperature"]
    assert by_name["speed"].share == pytest.approx(4900.0 / RIG.limits.rpm)
    assert by_name["speed"].value == 2450.0
    assert by_name["thrust"].share == pytest.approx(30.0 / RIG.limits.thrust_N)
    assert by_name["thrust"].value == -14.0
    assert by_name["voltage"].share == pytest.approx(6.0 / (16.0 - RIG.limits.voltage_min_V))
    assert by_name["temperature"].share == pytest.approx(
        10.0 / (RIG.limits.temperature_degC - 20.0)
    )
    assert by_name["pulse"].value == 1300.0


IDLE = {"voltage_V": 16.0, "temperature_degC": 22.0}


@pytest.mark.parametrize(("index", "idle"), [(0, IDLE), (1, IDLE), (1, {})])
def test_a_share_is_0_at_idle_and_1_at_the_limit(index, idle):
    limits, stop_us = RIG.limits, RIG.propulsion.pwm_stop_us
    readings = np.array(
        [[stop_us, limits.pwm_us], *[[0.0, limits.rpm]] * 2, [0.0, limits.thrust_N],
         [16.0, limits.voltage_min_V], [22.0, limits.temperature_degC], [0.0, limits.current_A]]
    )[:, index]  # fmt: skip
    shares = limit_shares(CHANNELS, np.tile(readings, (3, 1)), (readings[0],), RIG, {**idle})
    assert [share.share for share in shares] == pytest.approx([index] * 6)


def test_nothing_is_near_where_nothing_came():
    missing = np.full((3, len(NAMES)), np.nan)
    assert limit_shares(CHANNELS, missing, (), RIG, {}) == ()


def test_power_and_efficiency_follow_from_means_while_motors_turn():
    channels = tuple(
        Channel(name, unit)
        for name, unit in (("rpm1", "rpm"), ("thrust_N", "N"), ("torque_Nm", "N m"),
                           ("voltage_V", "V"), ("current_A", "A"))
    )  # fmt: skip
    nan = float("nan")
    samples = np.array([[6000.0, 3.0, 0.05, 11.0, 5.0], [6000.0, 5.0, 0.07, nan, 7.0]])
    context = measurement_context(rig=load_rig_by_name("pquad_single"))
    means = np.nanmean(samples, axis=0)
    values = live_values(channels, means, context, is_driven=True)
    assert values["thrust"] == (4.0, "N")
    assert values["electrical power"] == (pytest.approx(11.0 * 6.0), "W")
    shaft_W = 0.06 * 6000.0 * 2.0 * np.pi / 60.0
    assert values["mechanical power"] == (pytest.approx(shaft_W), "W")
    grams = 4.0 / 9.80665 * 1000.0 / 66.0
    assert values["overall efficiency"] == (pytest.approx(grams), "gf/W")
    assert values["motor and ESC efficiency"] == (pytest.approx(shaft_W / 66.0), "1")
    # At zero throttle only thrust is reported; without samples nothing is.
    assert list(live_values(channels, means, context, is_driven=False)) == ["thrust"]
    assert live_values(channels, np.full(5, nan), context, is_driven=True) == {}
