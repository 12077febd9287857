"""The chain over a real pseudo-terminal: a device here, its host in another process."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from numpy.typing import NDArray

from benchtool.bench.serial.bench import SerialBench
from benchtool.bench.transport.ports import SerialPort
from benchtool.core.errors import DeviceStopped, PortBusy
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.links import PtyLink
from benchtool.virtual.server import BenchServer, DeviceLink, ServerOutbox
from tests.system.served import DeviceTime, posix, turning
from tests.wire.still_plant import StillPlant, still_hello


class WatchedPlant(StillPlant):
    """Note when motors were commanded what, in the device's time."""

    def __init__(self, clock: DeviceTime) -> None:
        super().__init__(rate_Hz=200.0)
        self.clock = clock
        self.commands: list[tuple[float, float]] = []

    def command_pwm(self, pwm_us: NDArray[np.float64]) -> None:
        super().command_pwm(pwm_us)
        self.commands.append((self.clock(), float(pwm_us.max())))


class WatchedLink(DeviceLink):
    """Note when something was heard last, in the device's time."""

    heard_s = 0.0

    def receive(self, data: bytes, now_s: float) -> bytes:
        self.heard_s = now_s if data else self.heard_s
        return super().receive(data, now_s)


class Served:
    """Run a device in a thread."""

    def __init__(self, link: PtyLink) -> None:
        self.link = link
        clock = DeviceTime()
        self.plant = WatchedPlant(clock)
        self.firmware = Firmware(self.plant, still_hello(rate_Hz=200.0), clock())
        self.device = WatchedLink(self.firmware)
        self.server = BenchServer(self.device, link, lambda: self.plant.rate_Hz, clock=clock)
        self._going = True
        self._thread = threading.Thread(target=self.server.run, args=(lambda: self._going,))
        self._thread.start()

    def wait_for_a_stop(self) -> None:
        """Wait until the device itself has put motors to rest."""
        until_s = time.monotonic() + 10.0
        while self.firmware.latched is None and time.monotonic() < until_s:
            time.sleep(0.002)

    def end(self) -> None:
        self._going = False
        self._thread.join()
        self.link.close()


@pytest.fixture
def on_pty():
    served = Served(PtyLink())
    yield served
    served.end()


def bench_at(address: str) -> SerialBench:
    return SerialBench(SerialPort(address.removeprefix("serial:"), 2_000_000), address)


def read_on(bench: SerialBench, told: list[str]) -> None:
    """Read until something ends it; keep what the device says."""
    while True:
        told += bench.read(0.1).messages


def drive(bench: SerialBench, readings: int = 40) -> NDArray[np.float64]:
    """Spin and return so many rows; not one may be lost."""
    with bench:
        bench.move_plate(0.12)
        bench.tare()
        bench.set_pwm(np.array([1300.0, 1200.0]))
        rows: list[NDArray[np.float64]] = []
        while sum(map(len, rows)) < readings:
            got = bench.read(0.5)
            assert (got.lost, got.corrupt) == (0, 0)
            rows.append(got.values)
    return np.concatenate(rows)


@pytest.mark.real_time(deadline_s=0.1)
@posix
def test_drive_over_a_pseudo_terminal_twice(on_pty):
    for _ in range(2):
        last = drive(bench_at(on_pty.link.address))[-2:]
        np.testing.assert_array_equal(last[:, :2], [[1300, 1200]] * 2)
        assert np.nanmax(last[:, 2]) == 5.0
        assert np.all(last[:, 3] == 0.12)
        assert on_pty.plant.pwm_us.max() == 1000.0


@posix
def test_a_killed_host_leaves_motors_at_zero_within_300_ms(on_pty):
    address = on_pty.link.address
    with turning(f"{address}?baud=2000000", 1500.0) as host:
        with pytest.raises(PortBusy) as caught:
            bench_at(address).open()
        if sys.platform == "linux":
            assert f"(pid {host.pid})" in str(caught.value)
        time.sleep(0.3)
        assert on_pty.plant.commands[-1][1] == 1500.0
        host.send_signal(signal.SIGKILL)
        on_pty.wait_for_a_stop()
        stopped_s, pwm_us = on_pty.plant.commands[-1]
    assert pwm_us == 1000.0
    assert 0.2 < stopped_s - on_pty.device.heard_s < 0.3
    assert on_pty.firmware.latched is not None
    # The port is free again, and the next host finds a device that has been cleared.
    drive(bench_at(address))


@posix
def test_a_host_that_hangs_is_told_so(on_pty):
    with bench_at(on_pty.link.address) as bench:
        bench.set_pwm(np.array([1300.0, 1200.0]))
        on_pty.wait_for_a_stop()
        told: list[str] = []
        with pytest.raises(DeviceStopped, match="watchdog"):
            read_on(bench, told)
        told += bench.read(0.2).messages
    assert any(text.startswith("watchdog: no line for") for text in told)


def serve(*words: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "benchtool", "bench", "serve", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def ended(process: subprocess.Popen[str]) -> tuple[int, str]:
    _, errors = process.communicate(timeout=30)
    return process.returncode, errors


@pytest.mark.real_time(deadline_s=0.1)
@posix
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_serve_from_the_command_line(tmp_path, number):
    symlink = tmp_path / "bench"
    process = serve("--rig", "pquad", "--speed", "20", "--symlink", str(symlink))
    try:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        assert address == f"serial:{symlink}"
        with bench_at(address) as bench:
            identity = bench.identity
            assert identity.simulated
            assert identity.facts["speed"] == "20"
            bench.set_pwm(np.full(identity.n_rotors, 1500.0))
            start_s = bench.now_s()
            thrust_N = [np.nan]
            while bench.now_s() < start_s + 5.0:
                column = bench.read(0.5).values[
                    :, [c.name for c in identity.channels].index("thrust_N")
                ]
                thrust_N.extend(column)
        assert np.nanmax(thrust_N) > 5.0
        process.send_signal(number)
        code, errors = ended(process)
    finally:
        process.kill()
        process.wait()
    assert (code, symlink.is_symlink()) == (0, False), errors


def test_the_outbox_keeps_answers_and_counts_what_it_drops():
    outbox = ServerOutbox(room_bytes=10)
    for _ in range(5):
        outbox.add_sample(b"1234")
    outbox.add(b"answer")
    assert outbox.dropped == 3
    sent: list[bytes] = []

    def take_three(data: bytes) -> int:
        sent.append(data[:3])
        return 3

    for _ in range(10):
        outbox.flush(take_three)
    assert b"".join(sent) == b"12341234answer"
