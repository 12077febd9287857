"""A thrust stand behind the RCbenchmark GUI: `rcbudp:` addresses.

The GUI runs benchtool's bridge script, which takes pulses only while it is spoken to. As on every
bench whoever reads speaks, never a thread: a host whose control loop hangs falls silent, and the
script brings the motor down. The pulse itself, sent again, is the heartbeat.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchtool.bench.addresses import RcbAddress
from benchtool.bench.bench import Identity, Readings, StreamingBench
from benchtool.bench.clocks import DeviceClock
from benchtool.bench.rcbenchmark.lines import PULSE, BridgeHello, BridgeLine, StandClock, pulse_text
from benchtool.bench.rcbenchmark.link import BridgeLink
from benchtool.bench.transport.sockets import UdpSocket
from benchtool.bench.transport.transport import Transport
from benchtool.core.array import Array
from benchtool.core.channel import Channel, unit_in_name
from benchtool.core.errors import (
    BenchError,
    CommandRefused,
    DeviceStopped,
    InputError,
    LinkLost,
    StageError,
)

LEARN_S = 0.6
"""Readings are listened to for so long on opening (wall time): which channels live, how often."""

STALE_S = 1.0
"""A stand that brings no reading for so long is lost (wall time); as on every bench."""

ALIVE_S = 0.5
"""A script that answered the heartbeat so shortly ago is alive; six heartbeats, a choice."""

TARE_S = 20.0
"""Longest tare (wall time); a guess, the GUI takes a few seconds."""

ARRIVE_S = 120.0
LEAST_HZ = 1.0

LATE = 8
"""A reading so many numbers behind at most is late, not of a script started anew; a choice."""


class RcbBench(StreamingBench):
    """Drive one motor through the RCbenchmark GUI and read what its stand measures."""

    def __init__(
        self,
        transport: Transport,
        address: str,
        settings: RcbAddress | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(address)
        self._settings = settings or RcbAddress()
        self._link = BridgeLink(transport, address, clock)
        self._clock = clock
        self._speed = 1.0

    def now_s(self) -> float:
        if self._identity is None:
            return self._clock()
        return self._opened_s + (self._clock() - self._opened_s) * self._speed

    def open(self) -> None:
        if self._identity is not None:
            return
        self._opened_s = self._read_s = self._clock()
        self._device_clock, self._stand_clock = DeviceClock(), StandClock()
        self._rows: list[tuple[int, BridgeLine]] = []
        self._forget()
        self._messages: list[str] = [self._settings.warning] if self._settings.warning else []
        self._expected: int | None = None
        self._lost = 0
        self._moving, self._moved_ms = False, 0.0
        self._stopped, self._reported = "", False
        link = self._link
        try:
            hello = link.open()
            link.order(b"stop")
            link.order(b"average 1")
            self._clear()
            self._rows.clear()
            self._identity = self._learn(hello)
            self._expected, self._lost = None, 0
            self._link.decoder.corrupt = 0
        except BaseException:
            link.close()
            raise

    def close(self) -> None:
        if self._identity is None:
            return
        try:
            self._link.order(b"stop")
        except BenchError:
            pass  # The script brings the motor down where we cannot.
        finally:
            self._link.close()
            self._identity = None

    def set_pwm(self, pwm_us: Array) -> None:
        _ = self.identity  # raises while the bench is closed
        self._note()
        self._raise_if_stopped()
        pulses = np.asarray(pwm_us, float).ravel()
        if len(pulses) != 1 or not np.isfinite(pulses).all():
            raise InputError(
                f"pulses {pulses.tolist()} were not sent; 1 finite one is needed: the bridge "
                f"drives one ESC"
            )
        try:
            self._link.order(pulse_text(float(pulses[0])))
        except CommandRefused:
            self._note()
            self._raise_if_stopped()
            raise

    def stop(self) -> None:
        _ = self.identity  # raises while the bench is closed
        self._link.order(b"stop")

    def move_plate(self, z_m: float, x_m: float = 0.0, tilt_rad: float = 0.0) -> None:
        if not self.identity.moves_plate:
            raise StageError(
                "this stand does not move the plate; give --stage hand or --stage grbl:PORT"
            )
        self._note()
        self._raise_if_stopped()
        try:
            answer = self._link.order(f"virtual plate {z_m:.9g} {x_m:.9g} {tilt_rad:.9g}".encode())
        except CommandRefused as error:
            raise StageError(f"the plate stays where it is: {error.reason}") from error
        # A reading from before the answer still says where the plate stood then.
        begun_s, self._moving, self._moved_ms = self.now_s(), True, answer.entry.t_ms
        while self._moving:
            self._hold(self._read_fresh(0.05 * self._speed))
            if self.now_s() - begun_s > ARRIVE_S:
                self.stop()
                raise StageError(
                    f"the plate did not reach {z_m:g} m within {ARRIVE_S:g} s and was halted; look "
                    f"at the virtual stand"
                )

    def tare(self) -> None:
        """Let the GUI zero its load cells, which takes seconds."""
        _ = self.identity  # raises while the bench is closed
        self._link.order(b"tare", TARE_S)
        # What was measured before is not tared, whatever it is read for.
        self._note()
        self._rows.clear()

    def set_rate(self, rate_Hz: float) -> None:
        """Ask for means of so many readings that about this rate is left."""
        known = self.identity
        if not LEAST_HZ <= rate_Hz <= 1.25 * self._base_Hz:
            raise InputError(
                f"a stream of {rate_Hz:g} Hz is not possible; this stand reads {self._base_Hz:.4g} "
                f"times a second, and means of several leave {LEAST_HZ:g} Hz at least"
            )
        count = max(1, round(self._base_Hz / rate_Hz))
        self._link.order(b"average %d" % count)
        self._identity = replace(known, rate_Hz=self._base_Hz / count)
        self._read_s = self._clock()

    def read(self, timeout_s: float) -> Readings:
        _ = self.identity  # raises while the bench is closed
        return self._held_or(lambda: self._read_fresh(timeout_s))

    def _read_fresh(self, timeout_s: float) -> Readings:
        deadline_s = self._clock() + timeout_s / self._speed
        while True:
            self._note()
            if self._rows:
                return self._readings()
            # What was read before a stop is handed out first: no sample is lost to it.
            if not self._reported:
                self._raise_if_stopped()
            left_s = deadline_s - self._clock()
            if left_s <= 0.0:
                return self._readings()
            self._link.pump(left_s)
            self._check_silence()

    def _clear(self) -> None:
        """Lift the latch, once a motor that the script brings down stands."""
        until_s = self._clock() + 2.0
        while True:
            try:
                self._link.order(b"clear")
                break
            except CommandRefused:
                if self._clock() > until_s:
                    raise
                self._link.pump(0.05)
        self._link.take_lines()

    def _learn(self, hello: BridgeHello) -> Identity:
        """Listen for a while and return who answers, with the channels that live."""
        until_s = self._clock() + LEARN_S
        while (left_s := until_s - self._clock()) > 0.0 or not self._rows:
            self._link.pump(max(left_s, 0.02))
            self._note()
            self._check_silence()
        lines = [line.values.items() for _, line in self._rows]
        live = dict.fromkeys(name for line in lines for name, value in line if value == value)
        names = [
            PULSE,
            *(name for name in self._rows[0][1].values if name in live and name != PULSE),
        ]
        times_us = np.array([time_us for time_us, _ in self._rows], float)
        span_s = 1e-6 * (times_us[-1] - times_us[0])
        self._base_Hz = round((len(times_us) - 1) / span_s, 4) if span_s > 0.0 else LEAST_HZ
        self._names = names
        self._rows.clear()
        settings, virtual = self._settings, hello.is_virtual
        facts = {
            "pwm_stop_us": f"{hello.low_us:g}",
            "output": hello.output,
            "rpm_from": hello.speed,
            "ramp_ms": f"{hello.ramp_ms:g}",
        }
        if settings.warning:
            facts["warning"] = settings.warning
        if settings.thrust_scale != 1.0:
            facts["thrust_scale"] = f"{settings.thrust_scale:g}"
        if self._speed != 1.0:
            facts["speed"] = f"{self._speed:g}"
        bridge = f"bridge {hello.bridge}"
        return Identity(
            address=self.address,
            device_id=f"rcb-{hello.board}",
            firmware=f"RCbenchmark {hello.version}, firmware {hello.firmware}, {bridge}",
            protocol=f"rcbudp-{hello.bridge}",
            channels=tuple(Channel(name, unit_in_name(name)) for name in names),
            rate_Hz=self._base_Hz,
            n_rotors=1,
            simulated=virtual,
            moves_plate=virtual,
            limits={"pwm_us": hello.high_us, **hello.limits},
            watchdog_s=1e-3 * hello.silence_ms,
            speed=self._speed,
            facts=facts,
        )

    def _note(self) -> None:
        """Sort what has come: readings, losses, why the script stopped the motor."""
        for line in self._link.take_lines():
            if line.entry.why and not self._stopped:
                self._stopped = line.entry.why
                self._messages.append(line.entry.why)
            number = line.entry.n
            if number is None:
                continue
            self._read_s = self._clock()
            # Datagrams come twice or late: a reading counts once, and what comes behind its
            # successor stays lost. A script that was started anew counts from one again.
            if self._expected is not None and 0 < self._expected - number <= LATE:
                continue
            if self._expected is not None and number > self._expected:
                self._lost += number - self._expected
            self._expected = number + 1
            if line.entry.t_ms > self._moved_ms:
                self._moving = line.plate_moves
            self._speed = line.speed
            time_us = self._stand_clock.time_us(line.time_s, line.entry.t_ms)
            self._rows.append((time_us, line))

    def _raise_if_stopped(self) -> None:
        if self._stopped:
            self._reported = True
            raise DeviceStopped(
                f"the bridge script stopped the motor by itself ({self._stopped}); remove the "
                f"cause and start again"
            )

    def _check_silence(self) -> None:
        silent_s = self._clock() - self._read_s
        rate_Hz = self._identity.rate_Hz if self._identity else LEAST_HZ
        if silent_s <= max(STALE_S, 3.0 / rate_Hz):
            return
        alive_s = self._clock() - self._link.received_s
        what = (
            "the bridge script answers, but brings no readings; look at the stand's USB cable and "
            "at the GUI"
            if alive_s < ALIVE_S
            else "the script should stop the motor unless the GUI has gone as well; look at "
            "the GUI and at the motor, then start the script again"
        )
        raise LinkLost(
            f"{self.address} sent no reading for {silent_s:.1f} s, limit "
            f"{max(STALE_S, 3.0 / rate_Hz):g} s; {what}"
        )

    def _readings(self) -> Readings:
        rows, self._rows = self._rows, []
        times_us = np.array([time_us for time_us, _ in rows], np.int64)
        values = np.array(
            [[line.values[name] for name in self._names] for _, line in rows], float
        ).reshape(len(rows), len(self._names))
        if "thrust_N" in self._names:
            values[:, self._names.index("thrust_N")] *= self._settings.thrust_scale
        if len(rows):
            self._device_clock.learn(int(times_us[-1]), self.now_s())
        messages, self._messages = tuple(self._messages), []
        lost, self._lost = self._lost, 0
        corrupt, self._link.decoder.corrupt = self._link.decoder.corrupt, 0
        return Readings(
            time_s=self._device_clock.host_time_s(times_us),
            device_time_us=times_us.astype(float),
            values=values,
            lost=lost,
            corrupt=corrupt,
            messages=messages,
        )


def open_rcbudp(address: RcbAddress) -> RcbBench:
    """Return the bench behind the RCbenchmark GUI, not opened yet."""
    port = UdpSocket(address.host, address.port, listen=False, own_port=address.listen)
    return RcbBench(port, address.text, address)
