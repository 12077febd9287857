"""Manual throttle: dead-man switch, and a ramp that limits rises and applies falls at once."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np

from benchtool.bench.guard import GuardedBench
from benchtool.core.rig import Rig
from benchtool.web.bench_process.messages import HoldThrottle, ReleaseThrottle

RELEASE_TIMEOUT_S = 0.5  # dead-man time since the page reported the button as held


class DeadManSwitch:
    """Dead-man switch with the last report of the throttle button; thread-safe.

    `on_ended` is called with tab and reason of a press that ends other than by release.
    """

    def __init__(
        self,
        on_ended: Callable[[str, str], object] = lambda tab, reason: None,
        timeout_s: float = RELEASE_TIMEOUT_S,
    ) -> None:
        self._on_ended, self._timeout_s = on_ended, timeout_s
        self._last: tuple[HoldThrottle, float] | None = None
        self._ended_presses: dict[str, int] = {}
        self._lock = threading.Lock()

    def hold(self, report: HoldThrottle, now_s: float) -> None:
        """Store a report; late reports of an ended press are ignored."""
        with self._lock:
            if report.press > self._ended_presses.get(report.tab, -1):
                self._last = (report, now_s)

    def release(self, release: ReleaseThrottle) -> None:
        """End a press, including one whose first report has not arrived yet."""
        with self._lock:
            last = self._last[0] if self._last is not None else None
            is_same_tab = last is not None and last.tab == release.tab
            if last is not None and is_same_tab and last.press <= (release.press or last.press):
                self._last = None
                self._mark_ended(last.tab, last.press)
            if release.press is not None:
                self._mark_ended(release.tab, release.press)

    def _mark_ended(self, tab: str, press: int) -> None:
        self._ended_presses[tab] = max(press, self._ended_presses.get(tab, -1))

    def end_press(self, reason: str) -> None:
        """End the current press even if the button is still held."""
        if (last := self._last) is not None:
            self.release(ReleaseThrottle(last[0].tab, last[0].press))
            self._on_ended(last[0].tab, reason)

    def current_press(self, now_s: float) -> HoldThrottle | None:
        """Return the current press; None if the button is released or its reports timed out."""
        last = self._last
        if last is None:
            return None
        report, received_s = last
        link_s = now_s - received_s
        silence_s = link_s + report.age_s
        if silence_s <= self._timeout_s:
            return report
        cause = "the page is too busy" if report.age_s > link_s else "no heartbeat from the browser"
        self.end_press(
            f"no report of the button for {1e3 * silence_s:.0f} ms; allowed: "
            f"{1e3 * self._timeout_s:.0f} ms: {cause}"
        )
        return None


SLEW_us_s = 500.0  # from standstill to half throttle in about a second; assumed
COMMAND_INTERVAL_S = 0.04  # between commands while the pulse width changes; assumed


class ThrottleRamp:
    """Ramp of the motors to the pulse width of a press."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._stop_us = np.full(rig.n_rotors, rig.propulsion.pwm_stop_us)
        self._command_s = 0.0

    def step(self, bench: GuardedBench, press: HoldThrottle | None, now_s: float) -> None:
        """Command one step towards the press's pulse width; without a press, zero throttle."""
        command_us = bench.pwm_us
        is_driven = bool((command_us > self._stop_us).any())
        if press is None:
            if is_driven:
                bench.stop()
            return
        if is_driven and now_s - self._command_s < COMMAND_INTERVAL_S:
            return
        target_us = self._stop_us.copy()
        for rotor in press.rotors:
            if 1 <= rotor <= self._rig.n_rotors:
                target_us[rotor - 1] = press.command_pwm_us
        start_us = self._rig.propulsion.pwm_start_us
        elapsed_s = min(now_s - self._command_s, 2.0 * COMMAND_INTERVAL_S) if is_driven else 0.0
        max_us = np.maximum(command_us, start_us) + SLEW_us_s * elapsed_s
        next_us = np.minimum(target_us, max_us)
        if not np.array_equal(next_us, command_us):
            bench.set_pwm(next_us)
        self._command_s = now_s
