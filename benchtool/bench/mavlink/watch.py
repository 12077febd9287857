"""What ends a run behind an autopilot: silence, a restart, its words, outputs, our own pause."""

from __future__ import annotations

from benchtool.bench.mavlink.drive import Drive
from benchtool.bench.mavlink.health import RESTARTED, SILENT_S, Health, silence_of
from benchtool.bench.mavlink.pilots import Order
from benchtool.bench.mavlink.rows import MavlinkRows
from benchtool.bench.mavlink.talk import MavlinkTalk
from benchtool.core.errors import DeviceStopped, HostPaused, LinkLost

PAUSE_S = 0.15
"""Nobody read for longer than this: the silence was ours, not that of the autopilot."""


class RunWatch:
    """Read on, send what must be sent again, and stop the motors before anybody is told why.

    Attributes:
        ask_again: orders to an autopilot that has started anew: its outputs are asked for, because
            only they show that its motors stand.

    Args:
        address: for messages.
        talk: the conversation.
        health: what the autopilot says of itself.
        drive: turns the motors.
        rows: outputs and time of the autopilot.
    """

    def __init__(
        self, address: str, talk: MavlinkTalk, health: Health, drive: Drive, rows: MavlinkRows
    ) -> None:
        self.ask_again: list[Order] = []
        self._address = address
        self._talk, self._health, self._drive, self._rows = talk, health, drive, rows
        self._pumped_s = talk.clock()
        self._stopped: str | None = None
        self._told = False
        talk.take_gap()

    def pump(self, timeout_s: float) -> None:
        """Take what arrives, send what must be sent again, and look for what ends a run.

        Raises:
            LinkLost: the autopilot is silent.
            HostPaused: nobody called this for so long that the motors stand; zero was commanded.
        """
        pause_s = self._talk.clock() - self._pumped_s
        if pause_s > PAUSE_S:
            self._health.skip(pause_s)
            self._talk.heard_s += pause_s
        self._talk.pump(timeout_s)
        self._pumped_s = now_s = self._talk.clock()
        silent_s = now_s - self._talk.heard_s
        if silent_s > SILENT_S:
            self._drive.cease()
        silence = silence_of(self._address, silent_s, self._health.silence_s(now_s))
        if silence is not None:
            raise silence
        said = self._health.take_fault()
        fault = self._came_back() or said
        try:
            fault = fault or self._drive.keep_on(now_s)
        except HostPaused:
            self._stop()
            raise
        if silent_s <= SILENT_S:
            fault = fault or self._drive.fault(self._rows.outputs_us, now_s)
        if fault is not None and self._stopped is None:
            self._stopped = fault
            if fault == RESTARTED:
                self._drive.end()
                for order in self.ask_again:
                    self._talk.order(order)
            self._stop()

    def raise_if_stopped(self, again: bool = True) -> None:
        """Refuse to go on after a fault.

        Args:
            again: also where it was raised before.

        Raises:
            DeviceStopped: what ended the run.
        """
        if self._stopped is None or (self._told and not again):
            return
        self._told = True
        raise DeviceStopped(
            f"the run was ended: {self._stopped}; zero was commanded; remove the cause and start "
            f"again"
        )

    def _came_back(self) -> str | None:
        """Return how the autopilot came back where it was silent while motors turned."""
        gap = self._talk.take_gap()
        if self._rows.time.rebooted or (gap and gap.from_start and self._health.driven):
            self._rows.time.rebooted = False
            return RESTARTED
        if gap and self._health.driven and self._drive.renews:
            return (
                f"nothing came from the autopilot for {gap.silent_s:.1f} s while a motor turned, "
                f"limit {SILENT_S:g} s"
            )
        return None

    def _stop(self) -> None:
        try:
            self._drive.stop()
        except LinkLost:
            pass  # They stop by their time-out.
