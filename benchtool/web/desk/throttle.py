"""Turn motors by hand: up slowly, down at once."""

from __future__ import annotations

import numpy as np

from benchtool.bench.guard import GuardedBench
from benchtool.core.rig import Rig
from benchtool.web.desk.asks import Hold

SLEW_us_s = 500.0
"""Pulses rise so fast: from standstill to half throttle in about a second. A choice."""

STEP_S = 0.04
"""Time between two commands while pulses change."""


class Throttle:
    """Bring motors to what a hand wants.

    Args:
        rig: pulses at which motors stand and start.
    """

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._stop_us = np.full(rig.n_rotors, rig.propulsion.pwm_stop_us)
        self._set_s = 0.0

    def follow(self, bench: GuardedBench, wanted: Hold | None, now_s: float) -> None:
        """Take one step towards what is wanted; with no hand there, zero at once."""
        now_us = bench.pwm_us
        turning = bool((now_us > self._stop_us).any())
        if wanted is None:
            if turning:
                bench.stop()
            return
        if turning and now_s - self._set_s < STEP_S:
            return
        target_us = self._stop_us.copy()
        for rotor in wanted.rotors:
            if 1 <= rotor <= self._rig.n_rotors:
                target_us[rotor - 1] = wanted.pulse_us
        start_us = self._rig.propulsion.pwm_start_us
        passed_s = min(now_s - self._set_s, 2.0 * STEP_S) if turning else 0.0
        most_us = np.maximum(now_us, start_us) + SLEW_us_s * passed_s
        next_us = np.minimum(target_us, most_us)
        if not np.array_equal(next_us, now_us):
            bench.set_pwm(next_us)
        self._set_s = now_s
