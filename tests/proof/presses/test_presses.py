"""STOP in ten ways beside what goes on, drawn from a seed; `make presses` goes on with it."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

from tests.browser.hands import STOPPED_S
from tests.proof.presses.presses import BLOCKED_MS, Scene, order_of, press_stop

if TYPE_CHECKING:
    pass


def test_the_pulse_at_the_device_is_zero_whatever_goes_on(page, device):
    scene, rng = Scene(page, device), random.Random(24)
    presses = [press_stop(scene, *pair, rng) for pair in order_of(10, rng)]
    assert max(press.zero_s for press in presses) < STOPPED_S
    # A blocked page hands STOP on when it is free again; the dead-man switch does not wait for it.
    assert max(press.ordered_s for press in presses) < STOPPED_S + BLOCKED_MS[1] / 1000.0
    turning = [press for press in presses if press.turning_us > 1000.0]
    assert len(turning) >= len(presses) // 2
