"""Sequence numbers of a link that loses, repeats and reorders frames, component by component."""

from __future__ import annotations

from datetime import UTC, date, datetime
from hashlib import sha256

import pytest

from benchtool.bench.mavlink.frames import LinkCounts, MavlinkFrames, MavlinkQuality, dialect
from benchtool.bench.mavlink.rows import TIME_MODULUS, BootTime, CompanionTime

WORDS = dialect()


def frames_of(count: int, component: int = 1, first: int = 0) -> list[bytes]:
    """Give frames that are numbered one after another."""
    sender = MavlinkFrames(1, component)
    sender._mav.seq = first
    made = WORDS.MAVLink_named_value_float_message
    return [sender.pack(made(10 * step, b"thrust", 1.0)) for step in range(count)]


def take(*frames: bytes) -> tuple[list[int], LinkCounts]:
    """Give the stamps of what is taken from frames, and the counts."""
    ours = MavlinkFrames()
    taken = [message.time_boot_ms for frame in frames for message in ours.parse(frame)]
    return taken, ours.take_counts(1)


def test_numbers_go_on_over_their_wrap():
    frames = frames_of(40, first=240)
    assert take(*frames) == ([10 * step for step in range(40)], LinkCounts(messages=40))


def test_a_gap_is_counted_across_the_wrap():
    frames = frames_of(40, first=240)
    _, counts = take(*frames[:10], *frames[30:])
    assert counts == LinkCounts(messages=20, lost=20)


def test_a_frame_that_comes_twice_is_dropped_and_counted():
    frames = frames_of(100)
    taken, counts = take(*frames[:90], frames[89], frames[88], *frames[90:], frames[99])
    assert taken == [10 * step for step in range(100)]
    assert counts == LinkCounts(messages=100, duplicates=3)


def test_a_frame_that_comes_late_is_not_lost():
    frames = frames_of(6)
    taken, counts = take(frames[0], frames[2], frames[1], *frames[3:])
    assert sorted(taken) == [0, 10, 20, 30, 40, 50]
    assert counts == LinkCounts(messages=6, reordered=1)


def test_a_late_frame_is_given_back_to_the_count_of_a_later_look():
    frames = frames_of(12)
    ours = MavlinkFrames()
    ours.parse(frames[0] + frames[2])
    assert ours.take_counts(1).lost == 1
    ours.parse(frames[1] + frames[3])
    assert ours.take_counts(1).lost == 0
    ours.parse(frames[6] + frames[7])
    assert ours.take_counts(1).lost == 1  # two are missing, one was counted too many before


def test_each_component_counts_for_itself():
    own, companion = frames_of(20, 1, first=7), frames_of(20, 191, first=130)
    mixed = [frame for pair in zip(own, companion, strict=True) for frame in pair]
    assert take(*mixed)[1] == LinkCounts(messages=40)


def test_one_that_numbers_nothing_has_lost_nothing():
    same = MavlinkFrames(1, 191)
    made = WORDS.MAVLink_named_value_float_message
    frames = []
    for step in range(20):
        same._mav.seq = 0
        frames.append(same.pack(made(20 * step, b"thrust", 1.0)))
    taken, counts = take(*frames)
    assert taken == [20 * step for step in range(20)]
    assert counts == LinkCounts(messages=20)


def test_damaged_frames_count_from_the_first_whole_one_on():
    ours = MavlinkFrames()
    whole, damaged = frames_of(2)
    damaged = damaged[:-1] + bytes([damaged[-1] ^ 1])
    for frame, corrupt in ((damaged, 0), (whole, 0), (damaged, 1), (damaged, 2)):
        ours.parse(frame)
        assert ours.corrupt == corrupt
    assert (ours.take_counts(1).corrupt, ours.corrupt) == (2, 0)


def test_jitter_is_how_unevenly_steps_arrive():
    quality = MavlinkQuality()
    quality.counts.add(LinkCounts(messages=3, lost=2, duplicates=1, reordered=4))
    # The third is no step: it was made when the second was.
    for arrived_s, device_s in ((7.0, 1.0), (8.003, 2.0), (8.5, 2.0), (9.497, 3.0)):
        quality.arrived(arrived_s, device_s)
    assert quality.facts() == {
        "link_lost": "2 of 5 messages",
        "link_duplicates": "1",
        "link_reordered": "4",
        "link_jitter_ms": "3.00",
    }
    quality = MavlinkQuality()
    for arrived_s, jitter_ms in ((7.0, "0.00"), (8.003, "3.00")):
        quality.arrived(arrived_s, round(arrived_s))
        assert quality.facts()["link_jitter_ms"] == jitter_ms


def test_a_signature_counts_from_2015_on():
    key, now = bytes(range(32)), datetime(2020, 3, 1, 0, 0, 30, tzinfo=UTC)
    signing = MavlinkFrames(key=key, now_s=now.timestamp())
    made = WORDS.MAVLink_named_value_float_message(0, b"thrust", 1.0)
    days = (date(2020, 3, 1) - date(2015, 1, 1)).days
    for sent in range(2):
        frame = signing.pack(made)
        body, link, stamp, signature = frame[:-13], frame[-13:-12], frame[-12:-6], frame[-6:]
        # Tens of microseconds since 2015-01-01, one more with every frame (MAVLink 2 signing).
        assert int.from_bytes(stamp, "little") == (days * 86_400 + 30) * 100_000 + sent
        assert link == b"\0"
        assert signature == sha256(key + body + link + stamp).digest()[:6]


def test_microseconds_of_32_bits_go_on_over_their_wrap():
    time = BootTime()
    told = [time.us32((TIME_MODULUS - 30_000 + 20_000 * step) % TIME_MODULUS) for step in range(5)]
    assert [us - told[0] for us in told] == [0, 20_000, 40_000, 60_000, 80_000]
    assert not time.rebooted


def test_the_first_stamp_of_32_bits_is_taken_as_it_is():
    time = BootTime()
    assert time.us64(1_700_000_000_000_000) == 0  # nothing is known of the boot yet
    assert time.us32(1_200_000_000) == 1_200_000_000
    assert not time.rebooted


def test_stamps_of_every_kind_lie_on_one_count():
    time = BootTime()
    boot_ms = 5_000_000  # 83 minutes: the 32 bits of microseconds have wrapped once
    assert time.ms32(boot_ms) == 5_000_000_000
    assert time.us32((1000 * boot_ms + 700) % TIME_MODULUS) == 5_000_000_700
    assert time.us64(5_000_001_000) == 5_000_001_000
    # Since 1970, or nothing at all: as late as the last that was told.
    assert time.us64(1_700_000_000_000_000) == 5_000_001_000
    assert time.us64(0) == 5_000_001_000


def test_milliseconds_wrap_after_seven_weeks():
    time = BootTime()
    first = time.ms32(TIME_MODULUS - 5)
    assert time.ms32(5) - first == 10_000
    assert not time.rebooted


@pytest.mark.parametrize("uptime_ms", [10_000, 2_000_000, 4_000_000_000])
def test_a_reboot_shows_and_time_goes_on(uptime_ms):
    time = BootTime()
    before = time.ms32(uptime_ms)
    after = time.ms32(3_000)
    assert time.rebooted
    assert before <= after
    assert time.ms32(3_020) - after == 20_000


def test_datagrams_in_the_wrong_order_are_no_reboot():
    time = BootTime()
    time.ms32(10_000)
    assert time.ms32(9_900) == 9_900_000
    assert time.ms32(10_020) == 10_020_000
    assert not time.rebooted


def test_a_companion_that_starts_anew_is_laid_on_the_time_of_its_arrival():
    time = CompanionTime()
    arrivals = [(10_000, 50_000_000), (10_020, 50_030_000), (100, 60_000_000), (120, 60_050_000)]
    found = [time.us(stamp_ms, arrived_us) for stamp_ms, arrived_us in arrivals]
    assert found == [50_000_000, 50_020_000, 60_000_000, 60_020_000]
