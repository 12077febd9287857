"""Virtual bench on a pseudo-terminal that prints motor commands and changes of its pulse width.

As a script it is the device; as a module it contains the client for fixtures.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from benchtool.bench.drivers import SimAddress
from benchtool.core.rig_file import load_rig_by_name
from benchtool.physics.model_file import load_model
from benchtool.virtual.devices import (
    ServerOptions,
    device_server,
    pitch_hello,
    pitch_plant,
    standard_truth,
    virtual_server,
)
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.links import PtyLink
from benchtool.virtual.server import BenchServer, DeviceLink

ROOT = Path(__file__).parents[2]
ORDER = re.compile(rb"\$C,\d+,(stop|pwm)(?:,\d+)?((?:,[\d.]+)*)\*")
"""Motor command: name, device time read by the host, pulse widths."""
POLL_INTERVAL_S = 0.001


class PrintingLink(DeviceLink):
    """Device link that prints every received motor command."""

    def __init__(self, firmware: Firmware) -> None:
        super().__init__(firmware)
        self._tail = b""
        self._pulse_us = 0.0

    def tick(self, n: int, now_s: float) -> tuple[bytes, list[bytes]]:
        output = super().tick(n, now_s)
        self._print_pulse()
        return output

    def _print_pulse(self) -> None:
        pulse_us = float(self.firmware.pwm_us.max())
        if pulse_us != self._pulse_us:
            self._pulse_us = pulse_us
            print(f"{time.time():.6f} pulse {pulse_us:.0f}", flush=True)

    def receive(self, data: bytes, now_s: float) -> bytes:
        if data:
            wall_time_s = time.time()
            buffer = self._tail + data
            end = buffer.rfind(b"\n") + 1
            for match in ORDER.finditer(buffer[:end]):
                pulses = [float(number) for number in match[2].split(b",") if number]
                max_us = max(pulses, default=0.0)
                print(f"{wall_time_s:.6f} {match[1].decode()} {max_us:.0f}", flush=True)
            self._tail = buffer[end:]
        response = super().receive(data, now_s)
        self._print_pulse()
        return response


@dataclass
class Device:
    """Address and sampling rate of a device with its received motor commands.

    `orders` contains wall time, command name and highest pulse width; `pulses` wall time and
    highest output pulse width at each change."""

    address: str
    rate_Hz: float
    orders: list[tuple[float, str, float]] = field(default_factory=list)
    pulses: list[tuple[float, float]] = field(default_factory=list)

    def turning_us(self) -> float:
        """Return the highest pulse width of the last command; 0 after a stop."""
        last = [max_us for _, _, max_us in self.orders[-1:]]
        return last[0] if last else 0.0

    def wait_for_us(self, pulse_us: float, timeout_s: float = 5.0) -> None:
        """Wait until the ramp has reached a pulse width."""
        deadline = time.monotonic() + timeout_s
        while self.turning_us() != pulse_us:
            assert time.monotonic() < deadline, f"{pulse_us} not reached: {self.orders[-5:]}"
            time.sleep(0.01)

    def stopped_after(self, since: float, timeout_s: float = 5.0, word: str = "") -> float:
        """Return the time from a wall time to the first stop after it, in s.

        Args:
            word: "stop" accepts only that command, no zero throttle.
        """
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            for time_s, order, max_us in list(self.orders):
                if time_s >= since and (order == "stop" or (not word and max_us <= 1000.0)):
                    return time_s - since
            time.sleep(0.005)
        raise AssertionError(f"no stop within {timeout_s} s: {self.orders[-5:]}")

    def pulse_at(self, wall_time_s: float) -> float:
        """Return the highest output pulse width at a wall time."""
        pulses = list(self.pulses)
        return ([max_us for time_s, max_us in pulses if time_s <= wall_time_s] or [0.0])[-1]

    def zero_after(self, since: float, timeout_s: float = 5.0) -> float:
        """Return the time from a wall time to zero output, in s; 0 if it was zero already."""
        if self.pulse_at(since) <= 1000.0:
            return 0.0
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            for time_s, max_us in list(self.pulses):
                if time_s >= since and max_us <= 1000.0:
                    return time_s - since
            time.sleep(0.005)
        raise AssertionError(f"output not zero within {timeout_s} s: {self.pulses[-5:]}")


@contextmanager
def served_device(
    rig: str = "pquad",
    speed: float = 1.0,
    rate_Hz: float = 200.0,
    warning: str = "",
    mode: str = "plate",
) -> Iterator[Device]:
    """Run a device in a separate process; `warning` is part of its hello."""
    options = [rig, str(speed), str(rate_Hz), warning, mode]
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.browser.device", *options],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    )
    assert process.stdout is not None
    assert process.stdin is not None
    device = Device(process.stdout.readline().strip(), rate_Hz)

    def read() -> None:
        for line in process.stdout or ():
            wall_time, name, max_us = line.split()
            if name == "pulse":
                device.pulses.append((float(wall_time), float(max_us)))
            else:
                device.orders.append((float(wall_time), name, float(max_us)))

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    try:
        yield device
    finally:
        process.terminate()
        process.wait(10)
        reader.join(5)
        process.stdout.close()
        process.stdin.close()


def end_with_the_test() -> None:
    """End this process when the test process ends or is killed."""
    sys.stdin.read()
    os._exit(0)


def main(rig_name: str, speed: str, rate_Hz: str, warning: str, mode: str) -> None:
    rig = load_rig_by_name(rig_name)
    link = PtyLink()
    if mode == "pitch":
        plant = pitch_plant(rig, SimAddress(rig=rig_name, schedule="identify"))
        options = ServerOptions(protocol=PrintingLink)
        serve(device_server(plant, pitch_hello(plant, 0), link, options), link)
        return

    def make_link(firmware: Firmware) -> PrintingLink:
        if warning:
            facts = {**firmware.hello.facts, "warning": warning}
            firmware.hello = replace(firmware.hello, facts=facts)
        return PrintingLink(firmware)

    truth = load_model(standard_truth(rig), rig).model
    options = ServerOptions(speed=float(speed), protocol=make_link)
    serve(virtual_server(rig, truth, link, options, rate_Hz=float(rate_Hz)), link)


def serve(server: BenchServer, link: PtyLink) -> None:
    threading.Thread(target=end_with_the_test, daemon=True).start()
    print(link.address, flush=True)
    with suppress(KeyboardInterrupt):  # Ctrl-C in a terminal ends the test process too
        server.run(interval_s=POLL_INTERVAL_S)


if __name__ == "__main__":
    main(*sys.argv[1:])
