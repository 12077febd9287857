"""Who turns the motors of an autopilot, and how they are stopped before anybody learns why."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

from benchtool.bench.mavlink import messages as mav
from benchtool.bench.mavlink.autopilots import AutopilotInfo
from benchtool.bench.mavlink.health import RESTARTED, Health, silence_message
from benchtool.bench.mavlink.link import SILENCE_TIMEOUT_S, MavlinkLink
from benchtool.bench.mavlink.rows import MavlinkRows
from benchtool.core.errors import CommandRefused, DeviceStopped, HostSuspended, LinkLost

ARM_TIMEOUT_S = 3.0  # from an accepted arming to a heartbeat that shows it; one comes per second

Outputs = tuple[float, ...]


class MotorDrive(ABC):
    """Turn motors, hold them turning while somebody reads, and stop them.

    Attributes:
        renews: whether motors turn by orders that lapse and are sent again.
    """

    renews = False

    def __init__(
        self,
        link: MavlinkLink,
        autopilot: AutopilotInfo,
        health: Health,
        arm: str,
        clock: Callable[[], float],
    ) -> None:
        self._link, self._autopilot, self._health = link, autopilot, health
        self._arm, self._clock = arm, clock
        self._ended = False
        self.highest_us = 0.0

    @abstractmethod
    def command(self, pulses_us: tuple[float, ...]) -> None:
        """Command the pulse of every rotor: us.

        Raises:
            CommandRefused: the autopilot refused it.
            InputError: it cannot turn these together.
            LinkLost: no acknowledgement came.
        """

    @abstractmethod
    def stop(self) -> None:
        """Stop every motor at once."""

    @abstractmethod
    def release(self) -> None:
        """Stop what was turned by us, before the link is closed."""

    def stop_renewing(self) -> None:  # noqa: B027 -- a loop on board has nothing to renew
        """Send no order to turn again; those that were sent end by themselves."""

    def end(self) -> None:
        """Send nothing at all any more: the autopilot has started anew."""
        self.stop_renewing()
        self._ended = True

    def renew(self, now_s: float) -> str | None:
        """Send what must be sent again; return why it is refused now, or None.

        Raises:
            HostSuspended: the last order is so old that its motors stand.
        """
        return None

    def seen(self, outputs_us: Outputs, now_s: float) -> tuple[int, int] | None:
        """Note what the outputs report; return a rotor and its output, newly found out."""
        return None

    def shown(self) -> bool:
        """Return whether the outputs, as last reported, show what is commanded."""
        return True

    def fault(self, outputs_us: Outputs, now_s: float) -> str | None:
        """Return why the outputs do not show what was commanded, or None."""
        return None


class PitchDrive(MotorDrive):
    """Leave the motors to the autopilot's own loop: arm it or wait for that, and disarm it."""

    _driven = False

    def command(self, pulses_us: tuple[float, ...]) -> None:
        if sum(pulses_us) / len(pulses_us) <= self._autopilot.pulses.idle_us:
            if self._driven:
                self.stop()
            return
        if self._driven:
            return
        if not self._health.armed and self._arm == "host":
            self._health.refusal = ""
            result = self._link.exchange(mav.MavCommand(mav.ARM_DISARM, (1.0, *[0.0] * 6)))
            if result != mav.ACCEPTED:
                raise CommandRefused("arm", self._health.refusal or mav.result_name(result))
        until_s = self._clock() + ARM_TIMEOUT_S
        while not self._health.armed and self._clock() < until_s:
            self._link.pump(0.02)
        if not self._health.armed:
            raise CommandRefused(
                "record",
                "it is not armed; arm it with its transmitter first, or put arm=host in the "
                "address",
            )
        self._driven, self.highest_us = True, max(pulses_us)
        self._health.drive(True, self._clock())

    def stop(self) -> None:
        self._driven, self.highest_us = False, 0.0
        self._health.drive(False, self._clock())
        if not self._ended:
            self._link.exchange(mav.MavCommand(mav.ARM_DISARM, (0.0, mav.FORCE_DISARM, *[0.0] * 5)))

    def release(self) -> None:
        # Whoever flies without us is not disarmed by us.
        if self._driven:
            self.stop()


COMMAND_INTERVAL_S = (
    0.15  # nobody read for longer than this: the silence was ours, not that of the autopilot
)


class RunWatch:
    """Read on, send what must be sent again, and stop the motors before anybody learns why.

    Attributes:
        request_again: orders to an autopilot that has started anew: its outputs are requested,
            because only they show that its motors stand.
    """

    def __init__(
        self, address: str, link: MavlinkLink, health: Health, drive: MotorDrive, rows: MavlinkRows
    ) -> None:
        self.request_again: list[mav.MavCommand] = []
        self._address = address
        self._link, self._health, self._drive, self._rows = link, health, drive, rows
        self._pumped_s = link.clock()
        self._stopped: str | None = None
        self._reported = False
        link.take_gap()

    def pump(self, timeout_s: float) -> None:
        """Take what arrives, send what must be sent again, and look for what ends a run.

        Raises:
            LinkLost: the autopilot is silent.
            HostSuspended: nobody called this for so long that the motors stand; zero was commanded.
        """
        pause_s = self._link.clock() - self._pumped_s
        if pause_s > COMMAND_INTERVAL_S:
            self._health.skip(pause_s)
            self._link.received_s += pause_s
        self._link.pump(timeout_s)
        self._pumped_s = now_s = self._link.clock()
        silent_s = now_s - self._link.received_s
        if silent_s > SILENCE_TIMEOUT_S:
            self._drive.stop_renewing()
        silence = silence_message(self._address, silent_s, self._health.silence_s(now_s))
        if silence is not None:
            raise silence
        text_fault = self._health.take_fault()
        fault = self._came_back() or text_fault
        try:
            fault = fault or self._drive.renew(now_s)
        except HostSuspended:
            self._stop()
            raise
        if silent_s <= SILENCE_TIMEOUT_S:
            fault = fault or self._drive.fault(self._rows.outputs_us, now_s)
        if fault is not None and self._stopped is None:
            self._stopped = fault
            if fault == RESTARTED:
                self._drive.end()
                for order in self.request_again:
                    self._link.order(order)
            self._stop()

    def raise_if_stopped(self, again: bool = True) -> None:
        """Raise what ended the run, after a fault; where `again` is False only once."""
        if self._stopped is None or (self._reported and not again):
            return
        self._reported = True
        raise DeviceStopped(
            f"the run was ended: {self._stopped}; zero was commanded; remove the cause and start "
            f"again"
        )

    def _came_back(self) -> str | None:
        """Return how the autopilot came back where it was silent while motors turned."""
        gap = self._link.take_gap()
        if self._rows.time.rebooted or (gap and gap.from_start and self._health.driven):
            self._rows.time.rebooted = False
            return RESTARTED
        if gap and self._health.driven and self._drive.renews:
            return (
                f"nothing came from the autopilot for {gap.silent_s:.1f} s while a motor turned, "
                f"limit {SILENCE_TIMEOUT_S:g} s"
            )
        return None

    def _stop(self) -> None:
        try:
            self._drive.stop()
        except LinkLost:
            pass  # They stop by their time-out.
