"""1 kHz with 12 channels over a pseudo-terminal beside emcee: nothing lost, little of a core.

Alone, and for longer: `tests/proof/benchmarks/bench_link.py`.
"""

from __future__ import annotations

import os

import pytest

from tests.proof.benchmarks.link_load import (
    RATE_HZ,
    device,
    emcee_beside,
    measure,
    read_with_ours,
    read_with_readline,
)

pytestmark = [
    pytest.mark.real_time(deadline_s=0.1),
    pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are POSIX"),
]

SECONDS, PLAIN_SECONDS = 10.0, 5.0

SHARE = 0.2
"""Of the time of a reader that takes one line after the other, beside the same load: a share of a
core alone would judge the processor and its other guests. It was 0.11 to 0.16."""


def test_1_kHz_beside_a_fit():
    with device() as port, emcee_beside():
        load = measure(read_with_ours, port, SECONDS)
    with device() as port, emcee_beside():
        plain = measure(read_with_readline, port, PLAIN_SECONDS)
    print(load, f"{load.core_share:.2%} of a core, line by line {plain.core_share:.2%}")
    assert load.rows >= 0.99 * SECONDS * RATE_HZ
    assert (load.lost, load.corrupt) == (0, 0)
    assert load.core_share <= SHARE * plain.core_share
