"""A minute at 1 kHz with 12 channels over a pseudo-terminal: nothing lost, 8 % of a core."""

from __future__ import annotations

import os
from contextlib import nullcontext
from typing import Any

import pytest

from tests.benchmarks.link_load import RATE_HZ, device, emcee_beside, measure, read_with_ours

pytestmark = [
    pytest.mark.real_time(deadline_s=0.1),
    pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are POSIX"),
]

SECONDS = 60.0


@pytest.mark.parametrize("beside", [nullcontext, emcee_beside], ids=["alone", "beside_emcee"])
def test_a_minute_at_1_kHz(beside: Any) -> None:
    with device() as port, beside():
        load = measure(read_with_ours, port, SECONDS)
    print(load, f"{load.core_share:.2%} of a core")
    assert load.rows >= 0.99 * SECONDS * RATE_HZ
    assert (load.lost, load.corrupt) == (0, 0)
    assert load.core_share <= 0.08
