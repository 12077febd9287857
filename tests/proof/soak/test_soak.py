"""A seeded sample of the soak; `make soak MINUTES=n` goes on for as long as it is given."""

from __future__ import annotations

import os

import pytest

from tests.proof.soak.soak import sweep
from tests.proof.soak.world import REAL

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are POSIX")

SAMPLE = [
    ("mavlink", 22),
    ("memory", 930676091),  # holds 850 samples back
    ("grbl", 598985610),  # turns a bit of a line of one byte
    ("pty", 3),
]


@pytest.mark.parametrize(("kind", "seed"), SAMPLE)
def test_no_row_is_lost_and_no_motor_turns_without_a_host(tmp_path, kind, seed):
    outcome = sweep(kind, seed, 1.5 if seed < 100 else 3.0, tmp_path)
    if kind not in REAL:  # in real time a fault may end the sweep before its motors turn
        assert sum(outcome.struck.values()) >= 1
        assert outcome.turned_s > 0.2
    assert outcome.troubles == [], outcome.said
