"""A virtual bench on a pseudo-terminal that prints, with the time of day, each order to its motors
and each change of its own highest pulse.

Run as a script it is the device; imported it gives the fixture's end of it.
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

from benchtool.core.rig_file import load_rig_by_name
from benchtool.physics.model_file import load_model
from benchtool.virtual.devices import (
    device_server,
    pitch_hello,
    pitch_plant,
    standard_truth,
    virtual_server,
)
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.links import PtyLink
from benchtool.virtual.protocol import DeviceLink
from benchtool.virtual.server import BenchServer

ROOT = Path(__file__).parents[2]
ORDER = re.compile(rb"\$C,\d+,(stop|pwm)(?:,\d+)?((?:,[\d.]+)*)\*")
"""Number, command, the device time that the host has read, pulses."""
NAP_S = 0.001


class PrintingLink(DeviceLink):
    """Print every order to the motors as it is taken from the wire."""

    def __init__(self, firmware: Firmware) -> None:
        super().__init__(firmware)
        self._tail = b""
        self._pulse_us = 0.0

    def tick(self, n: int, now_s: float) -> tuple[bytes, list[bytes]]:
        said = super().tick(n, now_s)
        self._note_pulse()
        return said

    def _note_pulse(self) -> None:
        pulse_us = float(self.firmware.pwm_us.max())
        if pulse_us != self._pulse_us:
            self._pulse_us = pulse_us
            print(f"{time.time():.6f} pulse {pulse_us:.0f}", flush=True)

    def receive(self, data: bytes, now_s: float) -> bytes:
        if data:
            now = time.time()
            whole = self._tail + data
            end = whole.rfind(b"\n") + 1
            for match in ORDER.finditer(whole[:end]):
                pulses = [float(number) for number in match[2].split(b",") if number]
                highest = max(pulses, default=0.0)
                print(f"{now:.6f} {match[1].decode()} {highest:.0f}", flush=True)
            self._tail = whole[end:]
        answer = super().receive(data, now_s)
        self._note_pulse()
        return answer


@dataclass
class Device:
    """Hold the address of a device and the orders to its motors: time of day, word, pulse.

    `pulses` are its own: time of day and highest pulse, at each change. `rate_Hz` is that of its
    samples."""

    address: str
    rate_Hz: float
    orders: list[tuple[float, str, float]] = field(default_factory=list)
    pulses: list[tuple[float, float]] = field(default_factory=list)

    def turning_us(self) -> float:
        """Return the highest pulse that was ordered last; 0 after a stop."""
        last = [highest for _, _, highest in self.orders[-1:]]
        return last[0] if last else 0.0

    def wait_for_us(self, wanted: float, timeout_s: float = 5.0) -> None:
        """Wait until the ramp has reached a pulse."""
        deadline = time.monotonic() + timeout_s
        while self.turning_us() != wanted:
            assert time.monotonic() < deadline, f"{wanted} was not reached: {self.orders[-5:]}"
            time.sleep(0.01)

    def stopped_after(self, since: float, timeout_s: float = 5.0, word: str = "") -> float:
        """Return when the first stop after a time of day came, in seconds after it.

        Args:
            word: "stop" takes that order alone, and no pulse of zero.
        """
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            for at, order, highest in list(self.orders):
                if at >= since and (order == "stop" or (not word and highest <= 1000.0)):
                    return at - since
            time.sleep(0.005)
        raise AssertionError(f"no stop came within {timeout_s} s: {self.orders[-5:]}")

    def pulse_at(self, at: float) -> float:
        """Return its own highest pulse at a time of day."""
        return ([highest for since, highest in list(self.pulses) if since <= at] or [0.0])[-1]

    def zero_after(self, since: float, timeout_s: float = 5.0) -> float:
        """Return after how many seconds its own pulses were zero; 0 where they were before."""
        if self.pulse_at(since) <= 1000.0:
            return 0.0
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            for at, highest in list(self.pulses):
                if at >= since and highest <= 1000.0:
                    return at - since
            time.sleep(0.005)
        raise AssertionError(f"its pulse was not zero within {timeout_s} s: {self.pulses[-5:]}")


@contextmanager
def served_device(
    rig: str = "pquad",
    speed: float = 1.0,
    rate_Hz: float = 200.0,
    warning: str = "",
    mode: str = "plate",
) -> Iterator[Device]:
    """Give a device in a process of its own; `warning` is a fact of its hello."""
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

    def note() -> None:
        for line in process.stdout or ():
            at, word, highest = line.split()
            if word == "pulse":
                device.pulses.append((float(at), float(highest)))
            else:
                device.orders.append((float(at), word, float(highest)))

    reader = threading.Thread(target=note, daemon=True)
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
    """End this process once whoever ran the test is gone, killed perhaps."""
    sys.stdin.read()
    os._exit(0)


def main(rig_name: str, speed: str, rate_Hz: str, warning: str, mode: str) -> None:
    rig = load_rig_by_name(rig_name)
    link = PtyLink()
    if mode == "pitch":
        plant = pitch_plant(rig, schedule="identify")
        serve(device_server(plant, pitch_hello(plant, 0), link, protocol=PrintingLink), link)
        return

    def speak(firmware: Firmware) -> PrintingLink:
        if warning:
            facts = {**firmware.hello.facts, "warning": warning}
            firmware.hello = replace(firmware.hello, facts=facts)
        return PrintingLink(firmware)

    truth = load_model(standard_truth(rig), rig).model
    options = {"speed": float(speed), "rate_Hz": float(rate_Hz)}
    serve(virtual_server(rig, truth, link, protocol=speak, **options), link)


def serve(server: BenchServer, link: PtyLink) -> None:
    threading.Thread(target=end_with_the_test, daemon=True).start()
    print(link.address, flush=True)
    with suppress(KeyboardInterrupt):  # a terminal's Ctrl-C ends whoever started this, too
        server.run(nap_s=NAP_S)


if __name__ == "__main__":
    main(*sys.argv[1:])
