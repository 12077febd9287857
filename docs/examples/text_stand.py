"""Driver of a thrust stand with a text protocol over TCP: `stand:` addresses."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchtool.bench.bench import ContextBench, DeviceInfo, Readings
from benchtool.bench.clocks import DeviceClock
from benchtool.bench.drivers import TcpAddress
from benchtool.bench.transport.ports import TcpSocket
from benchtool.bench.transport.transport import Transport
from benchtool.core.channel import Channel
from benchtool.core.errors import (
    BenchError,
    CommandRefused,
    DeviceStopped,
    InputError,
    LinkLost,
    StageError,
)

CHANNELS = (Channel("pwm1_us", "pwm_us"), Channel("rpm1", "rpm"), Channel("thrust_N", "N"))
ACK_TIMEOUT_S = 0.5
HEARTBEAT_INTERVAL_S = 0.08
STALE_TIMEOUT_S = 1.0
READ_TIMEOUT_S = 0.02


class TextStand(ContextBench):
    """Thrust stand with one motor."""

    def __init__(
        self, transport: Transport, address: str, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._transport, self.address, self.now_s = transport, address, clock

    def open(self) -> None:
        self._buffer, self._reply, self._stop_reason = b"", [""], ""
        self._clock = DeviceClock()
        self._rows: list[list[float]] = []
        self._last_sent_s = self._last_row_s = self.now_s()
        self._transport.open()
        try:
            device_id, firmware, stop_us, limit_us = self._send_command("id?")
            self._send_command("rate 100")
            self._send_command("stop")
        except BaseException:
            self._transport.close()
            raise
        self._identity = DeviceInfo(
            address=self.address,
            device_id=device_id,
            firmware=firmware,
            protocol="text-1",
            channels=CHANNELS,
            rate_Hz=100.0,
            n_rotors=1,
            simulated=device_id.startswith("virtual"),
            moves_plate=False,
            limits={"pwm_us": float(limit_us)},
            pwm_stop_us=float(stop_us),
        )

    def close(self) -> None:
        if self._identity is None:
            return
        try:
            self._send_command("stop")
        except BenchError:
            pass  # the device's watchdog stops the motor
        finally:
            self._transport.close()
            self._identity = None

    def set_pwm(self, pwm_us: NDArray[np.float64]) -> None:
        command_us, limit_us = np.ravel(pwm_us), self.identity.limits["pwm_us"]
        if len(command_us) != 1 or not 0.0 <= command_us[0] <= limit_us:
            raise InputError(
                f"pulse widths {command_us.tolist()} us are out of range; allowed: one value from "
                f"0 to {limit_us:g} us"
            )
        self._send_command(f"pwm {command_us[0]:g}")

    def stop(self) -> None:
        self._send_command("stop")

    def move_plate(self, z_m: float, x_m: float = 0.0, tilt_rad: float = 0.0) -> None:
        raise StageError("this stand has no stage; use --stage hand or --stage grbl:PORT")

    def tare(self) -> None:
        self._send_command("tare")

    def set_rate(self, rate_Hz: float) -> None:
        raise InputError("the sampling rate of this stand is fixed at 100 Hz; omit the rate")

    def read(self, timeout_s: float) -> Readings:
        _ = self.identity  # raises LinkLost if the bench is closed
        end_s = self.now_s() + timeout_s
        while not self._rows and (remaining_s := end_s - self.now_s()) > 0.0:
            self._receive(remaining_s)
            if (silence_s := self.now_s() - self._last_row_s) > STALE_TIMEOUT_S:
                raise LinkLost(
                    f"no data from {self.address} for {silence_s:.1f} s; check the cable"
                )
        if self._stop_reason:
            reason, self._stop_reason = self._stop_reason, ""
            raise DeviceStopped(f"the device stopped its motor ({reason}); remove the cause")
        table, self._rows = np.array(self._rows).reshape(-1, 1 + len(CHANNELS)), []
        if len(table):
            self._clock.update(int(table[-1, 0]), self.now_s())
        time_s = self._clock.host_time_s(table[:, 0].astype(np.int64))
        return Readings(time_s, table[:, 0], table[:, 1:])

    def _send_command(self, line: str) -> list[str]:
        """Send a command and return the fields of its acknowledgement."""
        command = line.partition(" ")[0]
        self._reply, end_s = [""], self.now_s() + ACK_TIMEOUT_S
        self._write_line(line)
        while self._reply[1:2] != [command]:
            if self.now_s() > end_s:
                raise LinkLost(f"no reply from {self.address} to {line!r} in {ACK_TIMEOUT_S:g} s")
            self._receive(READ_TIMEOUT_S)
        if self._reply[0] == "no":
            raise CommandRefused(line, " ".join(self._reply[2:]))
        return self._reply[2:]

    def _receive(self, timeout_s: float) -> None:
        """Send a heartbeat if one is due, and parse the received lines."""
        if self.now_s() - self._last_sent_s >= HEARTBEAT_INTERVAL_S:
            self._write_line("alive")
        self._buffer += self._transport.read(min(timeout_s, READ_TIMEOUT_S))
        *lines, self._buffer = self._buffer.split(b"\n")
        for kind, *fields in (line.decode("ascii", "replace").split() or [""] for line in lines):
            if kind == "r" and len(fields) == 1 + len(CHANNELS):
                self._rows.append([float(field) for field in fields])
                self._last_row_s = self.now_s()
            elif kind in ("ok", "no"):
                self._reply = [kind, *fields]
            elif kind == "stopped":
                self._stop_reason = " ".join(fields)

    def _write_line(self, line: str) -> None:
        self._transport.write(line.encode("ascii") + b"\n")
        self._last_sent_s = self.now_s()


class StandAddress(TcpAddress):
    """Address of a stand on a TCP port."""

    EXAMPLE = "stand:192.168.1.7:5000"


def open_stand(address: StandAddress) -> TextStand:
    """Return the closed bench of an address."""
    return TextStand(TcpSocket(address.host, address.port), address.text)
