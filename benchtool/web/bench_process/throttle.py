"""Turn motors by hand: a dead-man switch, and a ramp that goes up slowly and down at once."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np

from benchtool.bench.guard import GuardedBench
from benchtool.core.rig import Rig
from benchtool.web.bench_process.messages import HoldThrottle, ReleaseThrottle

RELEASE_TIMEOUT_S = 0.5  # dead-man time since the page reported the button as held


class DeadManSwitch:
    """Hold the last report that the throttle button is held; called from two threads.

    `ended` takes tab and reason of a press that ends other than by its release.
    """

    def __init__(
        self,
        ended: Callable[[str, str], object] = lambda tab, reason: None,
        silence_s: float = RELEASE_TIMEOUT_S,
    ) -> None:
        self._ended, self._silence_s = ended, silence_s
        self._last: tuple[HoldThrottle, float] | None = None
        self._over: dict[str, int] = {}
        self._lock = threading.Lock()

    def hold(self, hold: HoldThrottle, now_s: float) -> None:
        """Take a report. A press that was ended does not come back by being late."""
        with self._lock:
            if hold.press > self._over.get(hold.tab, -1):
                self._last = (hold, now_s)

    def release(self, release: ReleaseThrottle) -> None:
        """End a press, also one whose first report is still on its way."""
        with self._lock:
            held = self._last[0] if self._last is not None else None
            ours = held is not None and held.tab == release.tab
            if held is not None and ours and held.press <= (release.press or held.press):
                self._last = None
                self._end(held.tab, held.press)
            if release.press is not None:
                self._end(release.tab, release.press)

    def _end(self, tab: str, press: int) -> None:
        self._over[tab] = max(press, self._over.get(tab, -1))

    def end_press(self, reason: str) -> None:
        """End the present press although the button may still be held."""
        if (last := self._last) is not None:
            self.release(ReleaseThrottle(last[0].tab, last[0].press))
            self._ended(last[0].tab, reason)

    def wanted(self, now_s: float) -> HoldThrottle | None:
        """Return the present press; None when the button is not held, or its reports ceased."""
        last = self._last
        if last is None:
            return None
        hold, heard_s = last
        line_s = now_s - heard_s
        silent_s = line_s + hold.age_s
        if silent_s <= self._silence_s:
            return hold
        where = "the page is too busy" if hold.age_s > line_s else "no beat came from the browser"
        self.end_press(
            f"no report of the button for {1e3 * silent_s:.0f} ms, allowed are "
            f"{1e3 * self._silence_s:.0f} ms: {where}"
        )
        return None


SLEW_us_s = 500.0  # from standstill to half throttle in about a second; assumed
STEP_S = 0.04  # Time between two commands while pulses change


class ThrottleRamp:
    """Bring motors to the pulse of a press."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._stop_us = np.full(rig.n_rotors, rig.propulsion.pwm_stop_us)
        self._set_s = 0.0

    def follow(self, bench: GuardedBench, wanted: HoldThrottle | None, now_s: float) -> None:
        """Take one step towards the pressed pulse; without a press, zero at once."""
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
