"""Turn motors by the autopilot's motor test; its outputs are the acknowledgement."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from benchtool.bench.mavlink import messages as mav
from benchtool.bench.mavlink.autopilots import DETECTION_TIMEOUT_S, RESEND_INTERVAL_S, AutopilotInfo
from benchtool.bench.mavlink.drive import MotorDrive, Outputs
from benchtool.bench.mavlink.health import Health
from benchtool.bench.mavlink.link import SILENCE_TIMEOUT_S, MavlinkLink
from benchtool.core.errors import (
    CommandRefused,
    DeviceStopped,
    HostSuspended,
    LinkLost,
    RunInterrupted,
)

STOP_TIMEOUT_S = 1.0  # to a visible stop before the next motor: 0.06 s (ArduCopter) and the link
STOP_RETRY_INTERVALS_S = (
    0.1,
    0.1,
    0.2,
    0.3,
    0.3,
)  # wait of each try; motors end by themselves sooner
REASON_TIMEOUT_S = 0.1  # the words of a refusal lie before or just behind its acknowledgement

POLL_INTERVAL_S = 0.02


class TestDrive(MotorDrive):
    """Turn motors by the autopilot's motor test, whose orders end by themselves.

    Stopped first is what turns and shall not: on ArduPilot an order for another motor leaves the
    first one turning.
    """

    renews = True

    def __init__(
        self,
        link: MavlinkLink,
        autopilot: AutopilotInfo,
        health: Health,
        arm: str,
        clock: Callable[[], float],
    ) -> None:
        super().__init__(link, autopilot, health, arm, clock)
        self._outputs = OutputWatch(autopilot.pilot.name, autopilot.pulses.stop_us)
        self._known = list(autopilot.wiring.outputs)
        self._standing: tuple[mav.MavCommand, ...] = ()
        self._turning: dict[int, float] = {}
        self._sent_s = self._acked_s = 0.0

    def command(self, pulses_us: tuple[float, ...]) -> None:
        autopilot, wiring = self._autopilot, self._autopilot.wiring
        if self._ended:
            raise RunInterrupted("no motor was turned: the autopilot restarted; open it anew")
        range_us = autopilot.pulses
        turn = {
            motor: pulse_us
            for motor, pulse_us in zip(wiring.motors, pulses_us, strict=True)
            if pulse_us > range_us.stop_us and pulse_us >= range_us.low_us
        }
        orders = autopilot.pilot.turn(turn, range_us)
        self._link.gaps.begin(self._clock())
        self._standing, self.highest_us = (), max(turn.values(), default=0.0)
        stopping = tuple(sorted(set(self._turning) - set(turn)))
        if not turn or (stopping and not autopilot.pilot.together):
            stopping = wiring.motors
        if stopping:
            # A heartbeat that shows disarmed from here on is what was ordered.
            self._health.drive(False, self._clock())
            self._expect({}, self._clock())
            self._stop(stopping)
            self._turning = {m: us for m, us in self._turning.items() if m not in stopping}
        # Before anything is sent: an order whose acknowledgement is lost may be carried out.
        self._turning |= turn
        self._health.refusal = ""
        self._expect(turn, self._clock())
        if orders:
            # They lapse from when they were sent, however late the acknowledgement came.
            self._sent_s = self._give(orders)
        self._standing, self._turning = orders, turn
        self._health.drive(bool(turn), self._clock())

    def stop(self) -> None:
        self.stop_renewing()
        self._turning, self.highest_us = {}, 0.0
        now_s = self._clock()
        self._health.drive(False, now_s)
        self._outputs.command({}, now_s)
        if self._ended:
            return
        orders = self._autopilot.pilot.stop(self._autopilot.wiring.motors)
        for order in orders[1:]:
            self._link.order(order)
        for order in orders:
            self._link.exchange(order, STOP_RETRY_INTERVALS_S)

    def release(self) -> None:
        self.stop()

    def stop_renewing(self) -> None:
        self._standing = ()

    def renew(self, now_s: float) -> str | None:
        for command in {order.command for order in self._standing}:
            result = self._link.take_ack(command)
            if result in (mav.ACCEPTED, mav.IN_PROGRESS):
                self._acked_s = now_s
            elif result is not None:
                self.stop_renewing()
                return f"the autopilot refused to go on: {self._reason(result)}"
        since_s = now_s - self._sent_s
        if self._standing and since_s > mav.TIMEOUT_S:
            # The motors stand by now: an order that is sent again would start them anew.
            self.stop_renewing()
            raise HostSuspended(since_s, mav.TIMEOUT_S)
        if self._outputs.lapsed and now_s - self._acked_s > mav.TIMEOUT_S:
            self.stop_renewing()  # `fault` says why, soon
        if self._standing and since_s >= RESEND_INTERVAL_S:
            self._sent_s = now_s
            for order in self._standing:
                self._link.order(order)
        return None

    def seen(self, outputs_us: Outputs, now_s: float) -> tuple[int, int] | None:
        found = self._outputs.seen(outputs_us, now_s)
        if found is not None:
            self._known[found[0] - 1] = found[1]
        return found

    def shown(self) -> bool:
        return self._outputs.shown

    def fault(self, outputs_us: Outputs, now_s: float) -> str | None:
        lost_s = now_s - self._acked_s if self._turning else 0.0
        return self._outputs.fault(outputs_us, now_s, lost_s, self._link.slowest_s)

    def _expect(self, turn: Mapping[int, float], now_s: float) -> None:
        stop_us = self._autopilot.pulses.stop_us
        motors = zip(self._autopilot.wiring.motors, self._known, strict=True)
        self._outputs.command(
            {
                rotor: (output, turn.get(motor, stop_us))
                for rotor, (motor, output) in enumerate(motors, 1)
                if output or motor in turn
            },
            now_s,
        )

    def _stop(self, motors: tuple[int, ...]) -> None:
        """Stop motors and wait until the outputs show it: an acknowledgement proves nothing."""
        for order in self._autopilot.pilot.stop(motors):
            result = self._link.exchange(order)
            if result not in (mav.ACCEPTED, mav.IN_PROGRESS):
                raise CommandRefused(str(order), self._reason(result))
        until_s = self._clock() + STOP_TIMEOUT_S
        while not self._outputs.shown:
            if self._clock() > until_s:
                raise DeviceStopped(
                    f"{self._autopilot.pilot.name} acknowledged the stop of its motors, but its "
                    f"outputs do not show it after {STOP_TIMEOUT_S:g} s; no motor was turned; cut "
                    f"the power and look at what else commands them"
                )
            self._link.pump(POLL_INTERVAL_S)

    def _give(self, orders: tuple[mav.MavCommand, ...]) -> float:
        """Send orders to turn until they are acknowledged, or the outputs show them; return when.

        An acknowledgement may come late; silence and motors that nobody sees may not last.
        """
        begun_s = self._clock()
        waiting, sent_s = {order.command for order in orders}, -1e9
        for command in waiting:
            self._link.take_ack(command)
        while waiting:
            self._raise_if_paused()
            now_s = self._clock()
            silent_s = now_s - max(self._link.received_s, begun_s)
            is_over = silent_s > SILENCE_TIMEOUT_S or now_s - begun_s > REPORT_TIMEOUT_S
            # An order that is sent again would start motors anew that stand by now.
            if is_over or self._outputs.lapsed:
                raise LinkLost(
                    f"{self._autopilot.pilot.name} did not acknowledge an order to turn in "
                    f"{now_s - begun_s:.1f} s, and its outputs do not show it; motor tests end by "
                    f"themselves; check the link, then start again"
                )
            if now_s - sent_s >= RESEND_INTERVAL_S:
                sent_s = now_s
                for order in orders:
                    self._link.order(order)
            self._link.pump(POLL_INTERVAL_S)
            for command in sorted(waiting):
                result = self._link.take_ack(command)
                if result in (mav.ACCEPTED, mav.IN_PROGRESS):
                    self._acked_s = self._clock()
                    waiting.discard(command)
                elif result is not None:
                    raise CommandRefused(str(orders[0]), self._reason(result))
            if self._outputs.shown and self._outputs.reported_since(begun_s):
                self._acked_s = self._clock()
                break
        self._raise_if_paused()
        return sent_s

    def _raise_if_paused(self) -> None:
        """Refuse orders from before a pause of this computer; those that were sent lapsed."""
        if (paused_s := self._link.gaps.longest_s) > mav.TIMEOUT_S:
            self.stop_renewing()
            raise HostSuspended(paused_s, mav.TIMEOUT_S)

    def _reason(self, result: int) -> str:
        """Return why an order was refused, in the autopilot's own words where it has some."""
        until_s = self._clock() + REASON_TIMEOUT_S
        while not self._health.refusal and self._clock() < until_s:
            self._link.pump(POLL_INTERVAL_S)
        return self._health.refusal or mav.result_name(result)


TOLERANCE_US = 3.0  # rounding of pulses on the way through percent and timer ticks; assumed
GAP_S = 0.15  # outputs come at 10 Hz at least; a longer pause is one of the link or of the reader
REPORT_TIMEOUT_S = (
    1.0  # motors do not turn for longer without their outputs being reported; assumed
)
UNREPORTED_AT_REST_S = 3.0  # the same at rest: a restarted autopilot has forgotten requests


class OutputWatch:
    """Compare what outputs report with what was commanded.

    Attributes:
        shown: whether every output, as last reported, shows what was commanded.
        lapsed: whether a motor that was seen to turn, and shall, shows its stop.

    Args:
        stop_us: pulse of a motor that stands; outputs without any pulse stand as well.
    """

    def __init__(self, name: str, stop_us: float) -> None:
        self._name = name
        self._stop_us = stop_us
        self._wanted: dict[int, tuple[int, float]] = {}
        self._lately: list[tuple[float, int, float]] = []
        self._good_s: dict[int, float] = {}
        self._reported_s: float | None = None
        self._seen_turning: set[int] = set()
        self.shown = self.lapsed = False

    def reported_since(self, time_s: float) -> bool:
        return self._reported_s is not None and self._reported_s > time_s

    def command(self, wanted: Mapping[int, tuple[int, float]], now_s: float) -> None:
        """Note what outputs should show from now on.

        Args:
            wanted: by rotor (from 1): its output (from 1, 0 when not known) and its pulse in us.
        """
        for rotor, (output, pulse_us) in wanted.items():
            before = self._wanted.get(rotor)
            if before != (output, pulse_us):
                if before is not None:
                    self._lately.append((now_s, rotor, before[1]))
                self._good_s[rotor] = max(self._good_s.get(rotor, now_s), now_s)
        self._wanted = dict(wanted)
        self._seen_turning &= {rotor for rotor, (_, us) in wanted.items() if us > self._stop_us}
        self.shown = self.lapsed = False

    def seen(self, outputs_us: Outputs, now_s: float) -> tuple[int, int] | None:
        """Note what outputs report; a pulse commanded a moment ago is as good as the present one.

        Returns:
            a rotor whose output was not known, and the only output that follows it (from 1).
        """
        found = None
        gap_s = now_s - self._reported_s if self._reported_s is not None else 0.0
        self._reported_s = now_s
        if gap_s > GAP_S:
            # A pause of the link or of the reader says nothing about the outputs.
            self._good_s = {rotor: good_s + gap_s for rotor, good_s in self._good_s.items()}
        self._lately = [item for item in self._lately if now_s - item[0] <= DETECTION_TIMEOUT_S]
        self.shown, self.lapsed = True, False
        for rotor, (output, pulse_us) in self._wanted.items():
            # Where it is not known which output it is, the one that comes nearest.
            nearest = min(outputs_us, key=lambda us: abs(us - pulse_us))
            shown = outputs_us[output - 1] if output else nearest
            self.shown = self.shown and self._fits(shown, pulse_us)
            if output and pulse_us > self._stop_us and not self._fits(shown, self._stop_us):
                self._seen_turning.add(rotor)
            self.lapsed |= rotor in self._seen_turning and self._fits(shown, self._stop_us)
            allowed = [pulse_us, *(us for _, own, us in self._lately if own == rotor)]
            if any(self._fits(shown, us) for us in allowed):
                self._good_s[rotor] = now_s
                if not output and max(allowed) > self._stop_us:
                    found = self._only(rotor, outputs_us) or found
        if found is not None:
            self._wanted[found[0]] = (found[1], self._wanted[found[0]][1])
        return found

    def fault(
        self, outputs_us: Outputs, now_s: float, lost_s: float = 0.0, slowest_s: float = 0.0
    ) -> str | None:
        """Return what is wrong in a sentence, None while nothing is.

        Args:
            lost_s: since the last acknowledgement of an order that is sent again and again.
            slowest_s: longest time that an acknowledgement took.
        """
        if self._reported_s is None:
            return None
        late = f"; acknowledgements take up to {slowest_s:.1f} s: the link carries more than it can"
        late = late if slowest_s > DETECTION_TIMEOUT_S else ""
        for rotor, (output, pulse_us) in self._wanted.items():
            late_s = self._reported_s - self._good_s[rotor]
            if late_s <= DETECTION_TIMEOUT_S:
                continue
            shown = f"output {output} shows {outputs_us[output - 1]:g} us"
            where = shown if output else "no output shows it"
            if lost_s > DETECTION_TIMEOUT_S:
                return (
                    f"{self._name} acknowledged no order for {lost_s:.1f} s and {where} where "
                    f"rotor {rotor} was commanded {pulse_us:g} us: orders get lost on the way to "
                    f"it; check cable, radio and ports{late}"
                )
            return (
                f"rotor {rotor} was commanded {pulse_us:g} us and {self._name} acknowledged it, "
                f"but {where} after {late_s:.1f} s, limit "
                f"{DETECTION_TIMEOUT_S:g} s; look at the safety switch, the arming checks and the "
                f"map of outputs (benchtool bench map){late}"
            )
        unreported_s = now_s - self._reported_s
        turning = any(us > self._stop_us for _, us in self._wanted.values())
        if unreported_s > (REPORT_TIMEOUT_S if turning else UNREPORTED_AT_REST_S):
            return f"{self._name} has not reported its outputs for {unreported_s:.1f} s{late}"
        return None

    def _only(self, rotor: int, outputs_us: Outputs) -> tuple[int, int] | None:
        """Return a rotor with the one output that is driven, None where several are."""
        least_us = self._stop_us + TOLERANCE_US
        driven = [output for output, shown in enumerate(outputs_us, 1) if shown > least_us]
        turning = [own for own, (_, pulse_us) in self._wanted.items() if pulse_us > self._stop_us]
        return (rotor, driven[0]) if len(driven) == 1 and turning == [rotor] else None

    def _fits(self, shown: float, pulse_us: float) -> bool:
        if pulse_us <= self._stop_us:
            return shown <= self._stop_us + TOLERANCE_US
        return abs(shown - pulse_us) <= TOLERANCE_US
