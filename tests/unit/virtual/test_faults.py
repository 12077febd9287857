"""Faults on demand: named, seeded, and doing what they say."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.errors import UnknownChoice
from benchtool.virtual.faults import (
    Fault,
    FaultyPlant,
    LinkFaults,
    parse_fault,
)
from tests.wire.still_plant import StillPlant

LINE = b"0123456789" * 1000


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("corrupt:p=0.01", Fault("corrupt", p=0.01)),
        ("silence:at_s=12,for_s=2", Fault("silence", at_s=12.0, for_s=2.0)),
        ("unplug", Fault("unplug", at_s=5.0)),
        ("stuck:channel=rpm1,at_s=2", Fault("stuck", channel="rpm1", at_s=2.0)),
        ("over_thrust:thrust_N=50", Fault("over_thrust", at_s=5.0, for_s=1.0, thrust_N=50.0)),
        ("refuse_move:", Fault("refuse_move")),
    ],
)
def test_faults_by_name(text, fault):
    assert parse_fault(text) == fault


def test_bytes_are_lost_and_turned_with_their_probability():
    dropped = LinkFaults([parse_fault("drop:p=0.1")], np.random.default_rng(1)).carry(LINE, 0.0)
    assert 850 * 10 < len(dropped) < 950 * 10
    turned = LinkFaults([parse_fault("corrupt:p=0.1")], np.random.default_rng(1)).carry(LINE, 0.0)
    differing = sum(a != b for a, b in zip(LINE, turned, strict=True))
    assert 850 < differing < 1150
    again = LinkFaults([parse_fault("corrupt:p=0.1")], np.random.default_rng(1)).carry(LINE, 0.0)
    assert again == turned


def test_silence_swallows_and_delay_delivers_late():
    silent = LinkFaults([parse_fault("silence:at_s=1,for_s=0.5")])
    assert [silent.carry(b"x", t) for t in (0.9, 1.0, 1.4, 1.5)] == [b"x", b"", b"", b"x"]
    late = LinkFaults([parse_fault("delay:at_s=1,for_s=0.5")])
    assert [late.carry(b"%d" % i, 0.9 + 0.3 * i) for i in range(3)] == [b"0", b"", b"12"]


def test_the_cable_is_pulled_once_and_put_back():
    faults = LinkFaults([parse_fault("unplug:at_s=1,for_s=2")])
    seen = [faults.plugged(t) for t in (0.5, 1.0, 1.5, 3.0, 3.5, 0.0, 1.0)]
    assert seen == [None, False, None, True, None, None, None]


def test_a_stuck_channel_repeats_its_value_and_adds_none():
    plant = FaultyPlant(StillPlant(), [parse_fault("stuck:at_s=0.02,for_s=0.06")])
    plant.advance(2)
    plant.command_pwm(np.array([1100.0, 1100.0]))
    first = plant.advance(3)[:, 2]
    plant.command_pwm(np.array([1500.0, 1500.0]))
    second = plant.advance(5)[:, 2]
    np.testing.assert_array_equal(first, [2.0, np.nan, 2.0])
    np.testing.assert_array_equal(second, [np.nan, 2.0, np.nan, 10.0, np.nan])
    with pytest.raises(UnknownChoice, match="known: plate_z_m, pwm1_us"):
        FaultyPlant(StillPlant(), [parse_fault("stuck:channel=rpm9")])
