from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from benchtool.core.channel import Channel
from benchtool.core.rig_file import load_rig_by_name
from benchtool.data.derived import rig_circumstances
from benchtool.web.bench_process.publisher import HEAD, Decimator, merged, split
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
        frames.append(decimator.take(len(frames)))
    whole = frames[0]
    for frame in frames[1:]:
        whole = merged(whole, frame)
    low, high = split(whole)
    for column in range(3):
        present = samples[:, column][~np.isnan(samples[:, column])]
        if len(present):
            assert (low[column], high[column]) == (present.min(), present.max())
        else:
            assert np.isnan(low[column])
            assert np.isnan(high[column])
    assert np.frombuffer(whole, "<f4")[2] == len(samples)


def test_a_frame_says_session_time_and_count():
    decimator = Decimator(2, 1)
    decimator.add(np.array([[1.0], [3.0], [2.0]]))
    np.testing.assert_allclose(np.frombuffer(decimator.take(1.5), "<f4"), [2.0, 1.5, 3.0, 1.0, 3.0])
    empty = np.frombuffer(decimator.take(2.0), "<f4")
    assert empty[:HEAD].tolist() == [2.0, 2.0, 0.0]
    assert np.isnan(empty[HEAD:]).all()


def test_frames_of_two_sessions_are_not_joined():
    old, new = Decimator(1, 2), Decimator(2, 2)
    old.add(np.full((1, 2), 9.0))
    new.add(np.full((1, 2), 1.0))
    newer = new.take(0.1)
    assert merged(old.take(50.0), newer) == newer


LIMITS = load_rig_by_name("pquad").limits
NAMES = ("pwm1_us", "rpm1", "rpm2", "thrust_N", "voltage_V", "current_A")


def test_the_reading_that_is_nearest_counts():
    low = np.array([1000.0, 0.0, 0.0, -30.0, 10.0, 0.0])
    high = np.array([1000.0, 900.0, 4900.0, 2.0, 11.0, np.nan])
    near = {one.name: one for one in limit_shares(NAMES, low, high, (1200.0, 1300.0), LIMITS)}
    assert list(near) == ["thrust, N", "speed, rpm", "least voltage, V", "pulse, us"]
    assert near["speed, rpm"].share == pytest.approx(4900.0 / LIMITS.rpm)
    assert near["thrust, N"].value == 30.0
    assert near["least voltage, V"].share == pytest.approx(LIMITS.voltage_min_V / 10.0)
    assert near["pulse, us"].value == 1300.0


def test_nothing_is_near_where_nothing_came():
    gone = np.full(len(NAMES), np.nan)
    assert limit_shares(NAMES, gone, gone, (), LIMITS) == ()


def test_power_and_efficiency_follow_from_means_while_motors_turn():
    channels = tuple(
        Channel(name, unit)
        for name, unit in (("rpm1", "rpm"), ("thrust_N", "N"), ("torque_Nm", "N m"),
                           ("voltage_V", "V"), ("current_A", "A"))
    )  # fmt: skip
    nan = float("nan")
    samples = np.array([[6000.0, 3.0, 0.05, 11.0, 5.0], [6000.0, 5.0, 0.07, nan, 7.0]])
    known = rig_circumstances(load_rig_by_name("pquad_single"))
    found = live_values(channels, samples, known, turning=True)
    values = {one.name: (one.value, one.unit) for one in found}
    assert values["thrust"] == (4.0, "N")
    assert values["electrical power"] == (pytest.approx(11.0 * 6.0), "W")
    shaft_W = 0.06 * 6000.0 * 2.0 * np.pi / 60.0
    assert values["mechanical power"] == (pytest.approx(shaft_W), "W")
    grams = 4.0 / 9.80665 * 1000.0 / 66.0
    assert values["overall efficiency"] == (pytest.approx(grams), "gf/W")
    assert values["motor and ESC efficiency"] == (pytest.approx(shaft_W / 66.0), "1")
    # Of motors that stand, thrust alone says something; of a silent bench, nothing does.
    assert [one.name for one in live_values(channels, samples, known, turning=False)] == ["thrust"]
    assert live_values(channels, samples[:0], known, turning=True) == ()
