"""1 kHz with 12 channels over a pseudo-terminal beside emcee: nothing lost, 8 % of a core.

Alone, and for longer: `tests/benchmarks/bench_link.py`.
"""

from __future__ import annotations

import os

import pytest

from tests.benchmarks.link_load import RATE_HZ, device, emcee_beside, measure, read_with_ours

pytestmark = [
    pytest.mark.real_time(deadline_s=0.1),
    pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are POSIX"),
]

SECONDS = 15.0


def test_1_kHz_beside_a_fit() -> None:
    with device() as port, emcee_beside():
        load = measure(read_with_ours, port, SECONDS)
    print(load, f"{load.core_share:.2%} of a core")
    assert load.rows >= 0.99 * SECONDS * RATE_HZ
    assert (load.lost, load.corrupt) == (0, 0)
    assert load.core_share <= 0.08
