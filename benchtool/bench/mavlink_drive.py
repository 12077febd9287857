"""Who turns the motors of an autopilot: orders of the host, or the autopilot's own loop."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from benchtool.bench.mavlink_dialect import dialect
from benchtool.bench.mavlink_health import Health
from benchtool.bench.mavlink_learn import Learnt
from benchtool.bench.mavlink_outputs import OutputWatch
from benchtool.bench.mavlink_pilots import ARM_DISARM, FORCE_DISARM, RESEND_S, Order
from benchtool.bench.mavlink_talk import MavlinkTalk
from benchtool.errors import CommandRefused

ACCEPTED, IN_PROGRESS = 0, 5
"""MAV_RESULT of an order that is carried out."""

ARM_WAIT_S = 3.0
"""After an accepted arming the heartbeat must show it within this; it comes once a second."""

Outputs = tuple[int, ...]


class Drive(Protocol):
    """Turn motors, keep them turning while somebody reads, and stop them."""

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

    def keep_on(self, now_s: float) -> str | None:
        """Send what must be sent again; return why it is refused now, or None."""
        ...

    def seen(self, outputs_us: Outputs, now_s: float) -> tuple[int, int] | None:
        """Note what the outputs tell; return a rotor and its output, newly found out."""
        ...

    def fault(self, outputs_us: Outputs, now_s: float) -> str | None:
        """Return why the outputs do not show what was commanded, or None."""
        ...


class TestDrive:
    """Turn motors by the autopilot's motor test, whose orders end by themselves."""

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
        self._turning: set[int] = set()
        self.highest_us = 0.0
        self._sent_s = 0.0

    def command(self, pulses_us: tuple[float, ...]) -> None:
        learnt, wiring = self._learnt, self._learnt.wiring
        range_us = learnt.pulses
        turn = {
            motor: pulse_us
            for motor, pulse_us in zip(wiring.motors, pulses_us, strict=True)
            if pulse_us > range_us.stop_us and pulse_us >= range_us.low_us
        }
        orders = learnt.pilot.turn(turn, range_us)
        self.highest_us = max(turn.values(), default=0.0)
        stopping = tuple(sorted(self._turning - set(turn)))
        self._standing = ()
        # Before anything is sent: an order whose acknowledgement is lost may be carried out.
        self._turning |= set(turn)
        if not turn:
            self._order(learnt.pilot.stop(wiring.motors))
        elif stopping and learnt.pilot.together:
            self._order(learnt.pilot.stop(stopping))
        self._order(orders)
        now_s = self._clock()
        self._standing, self._sent_s, self._turning = orders, now_s, set(turn)
        self._health.drive(bool(turn), now_s)
        self._outputs.command(
            {
                rotor: (output, turn.get(motor, range_us.stop_us))
                for rotor, (motor, output) in enumerate(
                    zip(wiring.motors, self._known, strict=True), 1
                )
                if output or motor in turn
            },
            now_s,
        )

    def stop(self) -> None:
        self._standing, self._turning, self.highest_us = (), set(), 0.0
        now_s = self._clock()
        self._health.drive(False, now_s)
        self._outputs.command({}, now_s)
        for order in self._learnt.pilot.stop(self._learnt.wiring.motors):
            self._talk.exchange(order)

    def let_go(self) -> None:
        self.stop()

    def keep_on(self, now_s: float) -> str | None:
        for command in {order.command for order in self._standing}:
            result = self._talk.take_ack(command)
            if result not in (None, ACCEPTED, IN_PROGRESS):
                return f"the autopilot refused to go on: {_word(result)}"
        if self._standing and now_s - self._sent_s >= RESEND_S:
            self._sent_s = now_s
            for order in self._standing:
                self._talk.order(order)
        return None

    def seen(self, outputs_us: Outputs, now_s: float) -> tuple[int, int] | None:
        found = self._outputs.seen(outputs_us, now_s)
        if found is not None:
            self._known[found[0] - 1] = found[1]
        return found

    def fault(self, outputs_us: Outputs, now_s: float) -> str | None:
        return self._outputs.fault(outputs_us, now_s)

    def _order(self, orders: tuple[Order, ...]) -> None:
        for order in orders:
            result = self._talk.exchange(order)
            if result not in (ACCEPTED, IN_PROGRESS):
                shown = ",".join(f"{value:g}" for value in order.parameters)
                raise CommandRefused(f"{_name(order.command)} {shown}", _word(result))


class PitchDrive:
    """Leave the motors to the autopilot's own loop: arm it or wait for that, and disarm it."""

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
        self._driven = False
        self.highest_us = 0.0

    def command(self, pulses_us: tuple[float, ...]) -> None:
        if sum(pulses_us) / len(pulses_us) <= self._idle_us:
            if self._driven:
                self.stop()
            return
        if self._driven:
            return
        if not self._health.armed and self._arm == "host":
            result = self._talk.exchange(Order(ARM_DISARM, (1.0, *[0.0] * 6)))
            if result != ACCEPTED:
                why = "; ".join(self._health.texts[-2:]) or _word(result)
                raise CommandRefused("arm", why)
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
        self._talk.exchange(Order(ARM_DISARM, (0.0, FORCE_DISARM, *[0.0] * 5)))

    def let_go(self) -> None:
        # Whoever flies without us is not disarmed by us.
        if self._driven:
            self.stop()

    def keep_on(self, now_s: float) -> str | None:
        return None

    def seen(self, outputs_us: Outputs, now_s: float) -> tuple[int, int] | None:
        # The autopilot commands the outputs itself.
        return None

    def fault(self, outputs_us: Outputs, now_s: float) -> str | None:
        return None


def _word(result: int | None) -> str:
    """Return a MAV_RESULT in MAVLink's own word."""
    known = dialect().enums["MAV_RESULT"]
    return str(known[result].name).removeprefix("MAV_RESULT_") if result in known else str(result)


def _name(command: int) -> str:
    known = dialect().enums["MAV_CMD"]
    return str(known[command].name).removeprefix("MAV_CMD_") if command in known else str(command)
