"""Who turns the motors of an autopilot: orders of the host, or the autopilot's own loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

from benchtool.bench.mavlink.dialect import dialect
from benchtool.bench.mavlink.health import SILENT_S, Health
from benchtool.bench.mavlink.learn import Learnt
from benchtool.bench.mavlink.outputs import UNTOLD_S, OutputWatch
from benchtool.bench.mavlink.pilots import ARM_DISARM, FORCE_DISARM, RESEND_S, TIMEOUT_S, Order
from benchtool.bench.mavlink.talk import MavlinkTalk
from benchtool.core.errors import CommandRefused, DeviceStopped, HostPaused, LinkLost, RunStopped

ACCEPTED, IN_PROGRESS = 0, 5
"""MAV_RESULT of an order that is carried out."""

ARM_WAIT_S = 3.0
"""After an accepted arming the heartbeat must show it within this; it comes once a second."""

STOPPED_S = 1.0
"""Outputs must show a stop within this before another motor is turned. ArduCopter takes at most
0.06 s; the rest is room for the link."""

STOP_TRIES_S = (0.1, 0.1, 0.2, 0.3, 0.3)
"""How long each try of a stop waits for its acknowledgement; motors end by themselves sooner."""

REASON_S = 0.1
"""The words of a refusal lie before or just behind its acknowledgement."""

LOOK_S = 0.02

Outputs = tuple[int, ...]


class Drive(Protocol):
    """Turn motors, keep them turning while somebody reads, and stop them.

    Attributes:
        renews: whether motors turn by orders that lapse and are sent again.
    """

    renews: bool

    @property
    def highest_us(self) -> float:
        """Longest pulse that is commanded at present."""
        ...

    def command(self, pulses_us: tuple[float, ...]) -> None:
        """Command the pulse of every rotor: us.

        Raises:
            CommandRefused: the autopilot said no.
            InputError: it cannot turn these together.
            LinkLost: no acknowledgement came.
        """
        ...

    def stop(self) -> None:
        """Stop every motor at once."""
        ...

    def let_go(self) -> None:
        """Stop what was turned by us, before the link is closed."""
        ...

    def cease(self) -> None:
        """Send no order to turn again; those that were sent end by themselves."""
        ...

    def end(self) -> None:
        """Send nothing at all any more: the autopilot has started anew."""
        ...

    def keep_on(self, now_s: float) -> str | None:
        """Send what must be sent again; return why it is refused now, or None.

        Raises:
            HostPaused: the last order is so old that its motors stand.
        """
        ...

    def seen(self, outputs_us: Outputs, now_s: float) -> tuple[int, int] | None:
        """Note what the outputs tell; return a rotor and its output, newly found out."""
        ...

    def shown(self) -> bool:
        """Tell whether the outputs, as last told, show what is commanded."""
        ...

    def fault(self, outputs_us: Outputs, now_s: float) -> str | None:
        """Return why the outputs do not show what was commanded, or None."""
        ...


class TestDrive:
    """Turn motors by the autopilot's motor test, whose orders end by themselves.

    Stopped first is what turns and shall not: on ArduPilot an order for another motor leaves the
    first one turning.
    """

    renews = True

    def __init__(
        self,
        talk: MavlinkTalk,
        learnt: Learnt,
        health: Health,
        arm: str,
        clock: Callable[[], float],
    ) -> None:
        self._talk, self._learnt, self._health, self._clock = talk, learnt, health, clock
        self._outputs = OutputWatch(learnt.pilot.name, learnt.pulses.stop_us)
        self._known = list(learnt.wiring.outputs)
        self._standing: tuple[Order, ...] = ()
        self._turning: dict[int, float] = {}
        self._ended = False
        self.highest_us = 0.0
        self._sent_s = self._acked_s = 0.0

    def command(self, pulses_us: tuple[float, ...]) -> None:
        learnt, wiring = self._learnt, self._learnt.wiring
        if self._ended:
            raise RunStopped("no motor was turned: the autopilot restarted; open it anew")
        range_us = learnt.pulses
        turn = {
            motor: pulse_us
            for motor, pulse_us in zip(wiring.motors, pulses_us, strict=True)
            if pulse_us > range_us.stop_us and pulse_us >= range_us.low_us
        }
        orders = learnt.pilot.turn(turn, range_us)
        self._talk.gaps.begin(self._clock())
        self._standing, self.highest_us = (), max(turn.values(), default=0.0)
        stopping = tuple(sorted(set(self._turning) - set(turn)))
        if not turn or (stopping and not learnt.pilot.together):
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
            self._give(orders)
        self._standing, self._sent_s = orders, self._clock()
        self._turning = turn
        self._health.drive(bool(turn), self._sent_s)

    def stop(self) -> None:
        self.cease()
        self._turning, self.highest_us = {}, 0.0
        now_s = self._clock()
        self._health.drive(False, now_s)
        self._outputs.command({}, now_s)
        if self._ended:
            return
        orders = self._learnt.pilot.stop(self._learnt.wiring.motors)
        for order in orders[1:]:
            self._talk.order(order)
        for order in orders:
            self._talk.exchange(order, STOP_TRIES_S)

    def let_go(self) -> None:
        self.stop()

    def cease(self) -> None:
        self._standing = ()

    def end(self) -> None:
        self.cease()
        self._ended = True

    def keep_on(self, now_s: float) -> str | None:
        for command in {order.command for order in self._standing}:
            result = self._talk.take_ack(command)
            if result in (ACCEPTED, IN_PROGRESS):
                self._acked_s = now_s
            elif result is not None:
                self.cease()
                return f"the autopilot refused to go on: {self._reason(result)}"
        since_s = now_s - self._sent_s
        if self._standing and since_s > TIMEOUT_S:
            # The motors stand by now: an order that is sent again would start them anew.
            self.cease()
            raise HostPaused(since_s, TIMEOUT_S)
        if self._standing and since_s >= RESEND_S:
            self._sent_s = now_s
            for order in self._standing:
                self._talk.order(order)
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
        return self._outputs.fault(outputs_us, now_s, lost_s, self._talk.slowest_s)

    def _expect(self, turn: Mapping[int, float], now_s: float) -> None:
        """Note what the outputs should show from now on."""
        stop_us = self._learnt.pulses.stop_us
        motors = zip(self._learnt.wiring.motors, self._known, strict=True)
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
        self._order(self._learnt.pilot.stop(motors))
        until_s = self._clock() + STOPPED_S
        while not self._outputs.shown:
            if self._clock() > until_s:
                raise DeviceStopped(
                    f"{self._learnt.pilot.name} acknowledged the stop of its motors, but its "
                    f"outputs do not show it after {STOPPED_S:g} s; no motor was turned; cut the "
                    f"power and look at what else commands them"
                )
            self._talk.pump(LOOK_S)

    def _give(self, orders: tuple[Order, ...]) -> None:
        """Send orders to turn until they are acknowledged, or until the outputs show them.

        An acknowledgement may come late; silence and motors that nobody sees may not last.
        """
        begun_s = self._clock()
        waiting, sent_s = {order.command for order in orders}, -1e9
        for command in waiting:
            self._talk.take_ack(command)
        while waiting:
            self._raise_if_paused()
            now_s = self._clock()
            silent_s = now_s - max(self._talk.heard_s, begun_s)
            if silent_s > SILENT_S or now_s - begun_s > UNTOLD_S:
                raise LinkLost(
                    f"{self._learnt.pilot.name} did not acknowledge an order to turn in "
                    f"{now_s - begun_s:.1f} s, and its outputs do not show it; motor tests end by "
                    f"themselves; check the link, then start again"
                )
            if now_s - sent_s >= RESEND_S:
                sent_s = now_s
                for order in orders:
                    self._talk.order(order)
            self._talk.pump(LOOK_S)
            for command in sorted(waiting):
                result = self._talk.take_ack(command)
                if result in (ACCEPTED, IN_PROGRESS):
                    self._acked_s = self._clock()
                    waiting.discard(command)
                elif result is not None:
                    raise CommandRefused(_shown(orders[0]), self._reason(result))
            if self._outputs.shown and self._outputs.told_since(begun_s):
                self._acked_s = self._clock()
                break
        self._raise_if_paused()

    def _raise_if_paused(self) -> None:
        """Refuse orders to turn from before a pause of this computer; those that were sent lapsed.

        Raises:
            HostPaused: how long it was.
        """
        if (paused_s := self._talk.gaps.longest_s) > TIMEOUT_S:
            self.cease()
            raise HostPaused(paused_s, TIMEOUT_S)

    def _order(self, orders: tuple[Order, ...]) -> None:
        for order in orders:
            result = self._talk.exchange(order)
            if result not in (ACCEPTED, IN_PROGRESS):
                raise CommandRefused(_shown(order), self._reason(result))

    def _reason(self, result: int) -> str:
        """Return why an order was refused, in the autopilot's own words where it has some."""
        until_s = self._clock() + REASON_S
        while not self._health.refusal and self._clock() < until_s:
            self._talk.pump(LOOK_S)
        return self._health.refusal or _word(result)


class PitchDrive:
    """Leave the motors to the autopilot's own loop: arm it or wait for that, and disarm it."""

    renews = False

    def __init__(
        self,
        talk: MavlinkTalk,
        learnt: Learnt,
        health: Health,
        arm: str,
        clock: Callable[[], float],
    ) -> None:
        self._talk, self._health, self._clock, self._arm = talk, health, clock, arm
        self._idle_us = learnt.pulses.idle_us
        self._driven = self._ended = False
        self.highest_us = 0.0

    def command(self, pulses_us: tuple[float, ...]) -> None:
        if sum(pulses_us) / len(pulses_us) <= self._idle_us:
            if self._driven:
                self.stop()
            return
        if self._driven:
            return
        if not self._health.armed and self._arm == "host":
            self._health.refusal = ""
            result = self._talk.exchange(Order(ARM_DISARM, (1.0, *[0.0] * 6)))
            if result != ACCEPTED:
                raise CommandRefused("arm", self._health.refusal or _word(result))
        until_s = self._clock() + ARM_WAIT_S
        while not self._health.armed and self._clock() < until_s:
            self._talk.pump(0.02)
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
            self._talk.exchange(Order(ARM_DISARM, (0.0, FORCE_DISARM, *[0.0] * 5)))

    def let_go(self) -> None:
        # Whoever flies without us is not disarmed by us.
        if self._driven:
            self.stop()

    def cease(self) -> None:
        """Do nothing: the autopilot's own loop turns the motors."""

    def end(self) -> None:
        self._ended = True

    def keep_on(self, now_s: float) -> str | None:
        return None

    def seen(self, outputs_us: Outputs, now_s: float) -> tuple[int, int] | None:
        # The autopilot commands the outputs itself.
        return None

    def shown(self) -> bool:
        return True

    def fault(self, outputs_us: Outputs, now_s: float) -> str | None:
        return None


def _word(result: int | None) -> str:
    """Return a MAV_RESULT in MAVLink's own word."""
    known = dialect().enums["MAV_RESULT"]
    return str(known[result].name).removeprefix("MAV_RESULT_") if result in known else str(result)


def _shown(order: Order) -> str:
    """Return an order as people write it."""
    return f"{_name(order.command)} {','.join(f'{value:g}' for value in order.parameters)}"


def _name(command: int) -> str:
    known = dialect().enums["MAV_CMD"]
    return str(known[command].name).removeprefix("MAV_CMD_") if command in known else str(command)
