from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from benchtool.web.bench_process.publisher import HEAD, Decimator, merged, split

values = arrays(
    float, st.tuples(st.integers(1, 30), st.just(3)),
    elements=st.one_of(st.just(float("nan")), st.floats(-1e6, 1e6, width=32)),
)  # fmt: skip


@given(values, st.integers(0, 30), st.integers(0, 30))
def test_no_extreme_is_missed_however_the_stream_is_cut(
    samples: np.ndarray, first: int, second: int
) -> None:
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


def test_a_frame_says_session_time_and_count() -> None:
    decimator = Decimator(2, 1)
    decimator.add(np.array([[1.0], [3.0], [2.0]]))
    np.testing.assert_allclose(np.frombuffer(decimator.take(1.5), "<f4"), [2.0, 1.5, 3.0, 1.0, 3.0])
    empty = np.frombuffer(decimator.take(2.0), "<f4")
    assert empty[:HEAD].tolist() == [2.0, 2.0, 0.0]
    assert np.isnan(empty[HEAD:]).all()


def test_frames_of_two_sessions_are_not_joined() -> None:
    old, new = Decimator(1, 2), Decimator(2, 2)
    old.add(np.full((1, 2), 9.0))
    new.add(np.full((1, 2), 1.0))
    newer = new.take(0.1)
    assert merged(old.take(50.0), newer) == newer
