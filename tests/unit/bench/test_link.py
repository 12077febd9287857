"""The protocol's bytes: what is sent is found again, whatever else is on the line."""

from __future__ import annotations

import warnings
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchtool.bench.clocks import DeviceClock
from benchtool.bench.serial.commands import RequestHello, SetPwm
from benchtool.bench.serial.frames import (
    HEARTBEAT,
    MAX_LINE_BYTES,
    Decoder,
    SampleFramer,
    frame,
    frame_command,
    frame_fields,
    split_messages,
)
from benchtool.bench.serial.hello import check_rate, max_rate_Hz
from benchtool.core.errors import InputError


def test_lines_as_sent():
    assert HEARTBEAT == b"$B*8976\n"
    spin = SetPwm((1200.0, 1200.5))
    assert frame_command(6, spin, (1 << 32) + 70) == frame(b"C,6,pwm,70,1200,1200.5")
    assert frame_command(1, RequestHello()) == frame(b"C,1,hello,2")


def test_text_cannot_break_a_line():
    line = frame_fields("E", ("note", "5*3 $ \r\n ü"))
    assert line.count(b"$") == line.count(b"*") == line.count(b"\n") == 1
    assert len(split_messages(line)) == 1


def test_samples_come_back(rng):
    values = np.round(rng.uniform(-1000, 20000, (500, 12)), 1)
    values[rng.random(values.shape) < 0.3] = np.nan
    values[0], values[:, -1] = np.nan, np.nan
    times_us = 5_000_000_000 + 1000 * np.arange(500)
    lines = b"".join(SampleFramer(12, sequence=65_400).frames(times_us, values))
    batch = Decoder(12).feed(lines)
    np.testing.assert_array_equal(batch.values, values)
    np.testing.assert_array_equal(np.diff(batch.device_time_us), 1000)
    assert (batch.lost, batch.corrupt) == (0, 0)


def test_device_time_goes_on_over_its_wrap():
    decoder = Decoder(1)
    times_us = (1 << 32) - 1500 + 1000 * np.arange(4)
    first, second = (
        decoder.feed(b"".join(SampleFramer(1, start).frames(times_us[part], np.ones((2, 1)))))
        for start, part in ((0, slice(0, 2)), (2, slice(2, 4)))
    )
    together = np.concatenate([first.device_time_us, second.device_time_us])
    np.testing.assert_array_equal(together, times_us)


def test_a_damaged_line_is_counted_and_left_out():
    lines = SampleFramer(2).frames(np.arange(5), np.ones((5, 2)))
    lines[2] = lines[2].replace(b",1", b",7", 1)
    batch = Decoder(2).feed(b"".join(lines))
    assert (len(batch.values), batch.corrupt, batch.lost) == (4, 1, 1)


@pytest.mark.parametrize("at", range(len(HEARTBEAT) - 1))
def test_no_byte_of_a_frame_may_be_another(at):
    decoder = Decoder()
    damaged = HEARTBEAT[:at] + b"#" + HEARTBEAT[at + 1 :]
    assert decoder.feed(HEARTBEAT + damaged + HEARTBEAT).corrupt == 1
    assert len(decoder.take_messages()) == 2


@pytest.mark.parametrize(
    "payload",
    [
        b"S,5,100,1",
        b"S,5,100,1,2,3",
        b"S,,100,1,2",
        b"S,5,,1,2",
        b"S,-1,100,1,2",
        b"S,5,99999999999,1,2",
        b"S,5,100,1,two",
        b"S,5,100,1 2,3",
        b"S,nan,nan,1,2",
    ],
)
def test_a_sample_that_makes_no_sense_spoils_no_other(payload):
    good = SampleFramer(2).frames(np.arange(2), np.array([[1.0, 2.0], [3.0, 4.0]]))
    for action in ("error", "ignore"):  # as in tests, and as when a bench is driven
        with warnings.catch_warnings(action=action):
            batch = Decoder(2).feed(good[0] + frame(payload) + good[1])
        np.testing.assert_array_equal(batch.values, [[1.0, 2.0], [3.0, 4.0]])
        assert (batch.corrupt, batch.lost) == (1, 0)


def test_samples_before_the_hello_are_passed_over():
    batch = Decoder().feed(_sample(3) + HEARTBEAT)
    assert (len(batch), batch.corrupt, batch.values.shape) == (0, 0, (0, 0))


def test_samples_are_on_the_clock_of_their_arrival():
    decoder = Decoder(2)
    first, second = decoder.feed(_sample(1), 7.0), decoder.feed(_sample(2) + _sample(3), 7.25)
    assert first.time_s.tolist() == [7.0]
    assert second.time_s == pytest.approx([7.001, 7.002], abs=1e-5)


def test_lines_with_carriage_return_are_taken():
    line = SampleFramer(1).frames(np.arange(1), np.ones((1, 1)))[0]
    batch = Decoder(1).feed(line.replace(b"\n", b"\r\n"))
    assert (len(batch.values), batch.corrupt) == (1, 0)


def test_boot_text_before_the_first_frame_is_not_corrupt():
    decoder = Decoder()
    batch = decoder.feed(b"half a line*12\r\nrst:0x1 (POWERON)\n" + HEARTBEAT + b"noise\n")
    assert len(decoder.take_messages()) == 1
    assert batch.corrupt == 1


def test_a_line_without_end_is_not_kept():
    decoder = Decoder()
    decoder.feed(HEARTBEAT)
    decoder.take_messages()
    for _ in range(100):
        assert decoder.feed(b"x" * MAX_LINE_BYTES).corrupt == 0
        assert len(decoder._partial_line) <= MAX_LINE_BYTES
    batch = decoder.feed(b"x" + HEARTBEAT + HEARTBEAT)
    assert (batch.corrupt, len(decoder.take_messages())) == (1, 1)


@pytest.mark.parametrize("more", [0, 1])
def test_the_longest_line_is_searched_for_frames(more):
    noise = b"x" * (MAX_LINE_BYTES - len(HEARTBEAT.rstrip()) + more)
    assert len(split_messages(noise + HEARTBEAT)) == 1 - more


def _cut(data: bytes, cuts: list[int]) -> list[bytes]:
    ends = sorted({min(cut, len(data)) for cut in cuts} | {0, len(data)})
    return [data[start:end] for start, end in pairwise(ends)]


def _result(chunks: list[bytes]) -> tuple[object, ...]:
    decoder = Decoder(2)
    batches = [decoder.feed(chunk) for chunk in chunks]
    return (
        [row for batch in batches for row in batch.values.tolist()],
        [time for batch in batches for time in batch.device_time_us.tolist()],
        decoder.take_messages(),
        sum(batch.lost for batch in batches),
        sum(batch.corrupt for batch in batches),
    )


def _sample(i: int) -> bytes:
    return frame(b"S,%d,%d,%d,2" % (i, i * 1000, i))


NOISE = st.one_of(
    st.binary(max_size=40),
    st.sampled_from([b"$", b"*", b"\n", b"\r\n", HEARTBEAT, HEARTBEAT[:-1], b"x" * 600]),
)
CUTS = st.lists(st.integers(0, 2000), max_size=20)


@given(st.lists(st.one_of(NOISE, st.integers(1, 9)), max_size=12), CUTS)
def test_any_chunking_gives_the_same(pieces, cuts):
    number, data = 0, frame(b"")
    for piece in pieces:
        number += piece if isinstance(piece, int) else 0
        data += _sample(number) if isinstance(piece, int) else piece
    assert _result([data]) == _result(_cut(data, cuts)) == _result([bytes([b]) for b in data])


@given(st.lists(st.integers(0, 9), min_size=1, max_size=12), CUTS)
def test_samples_in_any_order_come_out_in_order(numbers, cuts):
    decoder = Decoder(2)
    batches = [decoder.feed(data) for data in _cut(b"".join(map(_sample, numbers)), cuts)]
    found = [int(row[0]) for batch in batches for row in batch.values]
    assert found == sorted(set(found))
    assert set(found) <= set(numbers)
    assert len(found) + sum(batch.repeated for batch in batches) == len(numbers)
    assert len(found) + sum(batch.lost for batch in batches) == found[-1] - found[0] + 1


@given(st.lists(st.tuples(st.binary(max_size=60), st.booleans()), min_size=1, max_size=8))
def test_whole_frames_are_found_in_any_garbage(pieces):
    sent = [frame(b"E,note,%d" % i) for i in range(len(pieces))]
    data = b"".join(
        noise + (line if ended else line[:-1])
        for (noise, ended), line in zip(pieces, sent, strict=True)
    )
    # A line's end that got lost is made up for by the next frame's start.
    found = [
        message
        for message in split_messages(data + b"$\n")
        if message.letter == "E" and message.fields[:1] == ("note",)
    ]
    followed_by_dollar = [
        ended or i + 1 == len(pieces) or not pieces[i + 1][0] or pieces[i + 1][0][:1] in b"$\n"
        for i, (_, ended) in enumerate(pieces)
    ]
    expected = [str(i) for i, whole in enumerate(followed_by_dollar) if whole]
    assert set(expected) <= {message.fields[1] for message in found}


def test_the_refusal_shows_the_arithmetic():
    with pytest.raises(InputError) as caught:
        check_rate(1000.0, 101, 921_600)
    assert str(caught.value) == (
        "1000 frames/s x 101 bytes x 10 bits = 1,010,000 baud, but the link has 921,600 baud; "
        "request at most 912 Hz or raise baud on both ends"
    )


def test_what_fits_passes():
    check_rate(912.0, 101, 921_600)
    check_rate(1e6, 101, 0)
    assert max_rate_Hz(100, 1_000_000) == 1000.0


@pytest.mark.parametrize("rate_Hz", [-1.0, float("nan")])
def test_a_rate_that_is_none(rate_Hz):
    with pytest.raises(InputError, match="out of range"):
        check_rate(rate_Hz, 101, 0)


def test_host_time_is_right_to_the_smallest_delay(rng):
    clock = DeviceClock()
    drift = 1.0 + 50e-6
    device_us = np.arange(0, 120_000_000, 5_000)
    true_s = 1000.0 + device_us * 1e-6 * drift
    arrived_s = true_s + 0.001 + rng.exponential(0.004, len(true_s))
    host_s = np.empty_like(true_s)
    for i in range(0, len(device_us), 4):
        part = slice(i, i + 4)
        clock.update(int(device_us[part][-1]), float(arrived_s[part][-1]))
        host_s[part] = clock.host_time_s(device_us[part])
    error_s = (host_s - true_s)[len(host_s) // 4 :]
    assert np.all(np.diff(host_s) > 0.0)
    # One millisecond of delay is always there; the window lets drift add half of one.
    assert np.all(error_s > -0.001)
    assert np.all(error_s < 0.002)


def test_a_late_first_line_is_made_up_for():
    clock = DeviceClock()
    clock.update(0, 0.05)
    for step in range(1, 60_000):
        clock.update(5_000 * step, 0.005 * step)
    assert abs(float(clock.host_time_s(np.array([0]))[0])) < 1e-9


def times_of(device_us: np.ndarray, arrived_s: np.ndarray) -> np.ndarray:
    """Return the host times of lines that are looked at one by one."""
    clock, host_s = DeviceClock(), np.empty_like(arrived_s)
    for i, (time_us, at_s) in enumerate(zip(device_us.tolist(), arrived_s.tolist(), strict=True)):
        clock.update(time_us, at_s)
        host_s[i] = clock.host_time_s(device_us[i : i + 1])[0]
    assert np.all(np.diff(host_s) > 0.0)
    return host_s


def test_what_comes_sooner_than_the_clock_allows_corrects_it_soon():
    device_us = np.arange(0, 30_000_000, 10_000)
    true_s = device_us * 1e-6
    host_s = times_of(device_us, np.where(true_s < 1.0, true_s + 5.0, true_s))
    assert host_s[50] - true_s[50] == pytest.approx(5.0)
    late = true_s > 12.0
    np.testing.assert_allclose(host_s[late], true_s[late], atol=1e-6)


@pytest.mark.parametrize("drift", [0.995, 1.005])
def test_a_ceramic_resonator_is_followed(drift, rng):
    device_us = np.arange(0, 600_000_000, 50_000)
    true_s = device_us * 1e-6 * drift
    host_s = times_of(device_us, true_s + rng.exponential(0.004, len(true_s)))
    assert np.abs(host_s - true_s).max() < 0.15


def test_a_backlog_that_grows_does_not_pass_for_a_slow_clock():
    device_us = np.arange(0, 60_000_000, 50_000)
    true_s = device_us * 1e-6
    arrived_s = 1.1 * true_s
    assert (arrived_s - times_of(device_us, arrived_s))[-1] > 3.0
