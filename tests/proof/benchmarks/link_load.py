"""A device that streams 12 channels at 1 kHz over a pseudo-terminal, and readers to compare.

Run as a script this is the device; imported it gives the readers. Each reader writes every row to a
file and flushes it after each block, as a recording does; `read_with_readline` after each row.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import IO

import numpy as np
import serial
from numpy.typing import NDArray

from benchtool.bench.serial.bench import SerialBench
from benchtool.bench.serial.commands import RequestHello, SetRate
from benchtool.bench.serial.frames import crc16, frame_command
from benchtool.bench.serial.hello import Hello
from benchtool.bench.transport.ports import SerialPort
from benchtool.core.channel import Channel
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.links import PtyLink
from benchtool.virtual.server import BenchServer, DeviceLink

RATE_HZ = 1000.0
CHANNELS = (
    *(Channel(f"pwm{i}_us", "pwm_us") for i in (1, 2, 3, 4)),
    *(Channel(f"rpm{i}", "rpm") for i in (1, 2, 3, 4)),
    Channel("thrust_N", "N"),
    Channel("plate_z_m", "m"),
    Channel("voltage_V", "V"),
    Channel("current_A", "A"),
)

EMCEE = """
import emcee, numpy as np
x = np.linspace(0.0, 1.0, 100)
def log_probability(p):
    return -0.5 * np.sum((x * p[:, :1] + p[:, 1:2] - x) ** 2, axis=1)
start = np.random.default_rng(1).normal(size=(64, 2))
sampler = emcee.EnsembleSampler(64, 2, log_probability, vectorize=True)
print("sampling", flush=True)
for _ in sampler.sample(start, iterations=10**9, store=False):
    pass
"""


@dataclass(frozen=True)
class Load:
    """Hold what one reader cost: rows, losses, and the share of a core."""

    rows: int
    lost: int
    corrupt: int
    wall_s: float
    cpu_s: float

    @property
    def core_share(self) -> float:
        """Processor time over wall time."""
        return self.cpu_s / self.wall_s


class Noise:
    """Give rows of made-up readings, the same ones over and over."""

    channels = CHANNELS
    rate_Hz = RATE_HZ
    plate_moving = False

    def __init__(self) -> None:
        rng = np.random.default_rng(1)
        low = [1000.0] * 4 + [3000.0] * 4 + [5.0, 0.1, 11.0, 20.0]
        self._rows = np.round(np.array(low) * rng.uniform(1.0, 1.5, (4000, 12)), 3)
        self._at = 0

    def advance(self, n: int) -> NDArray[np.float64]:
        """Return the next rows."""
        rows = self._rows.take(np.arange(self._at, self._at + n), axis=0, mode="wrap")
        self._at = (self._at + n) % len(self._rows)
        return rows

    def set_rate(self, rate_Hz: float) -> None:
        """Stay at one rate."""

    def command_pwm(self, pwm_us: NDArray[np.float64]) -> None:
        """Do nothing."""

    def command_plate(self, z_m: float, x_m: float, tilt_rad: float) -> None:
        """Do nothing."""

    def halt_plate(self) -> None:
        """Do nothing."""

    def tare(self) -> None:
        """Do nothing."""


def be_the_device() -> None:
    """Stream until killed."""
    hello = Hello(
        device_id="load",
        firmware="load",
        n_rotors=4,
        channels=CHANNELS,
        channel_rates_Hz=(RATE_HZ,) * 12,
        rate_Hz=RATE_HZ,
        limits={},
        pwm_stop_us=1000.0,
        pwm_idle_us=1050.0,
    )
    plant, link = Noise(), PtyLink()
    print(link.address.removeprefix("serial:"), flush=True)
    device = DeviceLink(Firmware(plant, hello, time.monotonic()))
    BenchServer(device, link, lambda: RATE_HZ).run()


@contextmanager
def device() -> Iterator[str]:
    """Run the device in a process of its own; give its port."""
    with _beside([sys.executable, __file__]) as said:
        yield said


@contextmanager
def emcee_beside() -> Iterator[str]:
    """Run an endless emcee chain in a process of its own."""
    with _beside([sys.executable, "-c", EMCEE]) as said:
        yield said


@contextmanager
def _beside(words: list[str]) -> Iterator[str]:
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        yield process.stdout.readline().strip()
    finally:
        process.send_signal(signal.SIGTERM)
        process.communicate()


def read_with_ours(port: str, seconds: float, file: IO[str]) -> tuple[int, int, int]:
    """Read as a sweep does."""
    rows = lost = corrupt = 0
    with SerialBench(SerialPort(port, 2_000_000), f"serial:{port}") as bench:
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            readings = bench.read(0.1)
            rows += len(readings)
            lost += readings.lost
            corrupt += readings.corrupt
            file.writelines(",".join(map(repr, row)) + "\n" for row in readings.values.tolist())
            file.flush()
    return rows, lost, corrupt


def _start_stream(link: serial.Serial) -> None:
    link.write(frame_command(1, RequestHello()))
    while not (answer := link.readline()).startswith(b"$A,1,"):
        pass
    link.write(frame_command(2, SetRate(RATE_HZ), int(answer.split(b",")[2])))


def read_bare(port: str, seconds: float, file: IO[str]) -> tuple[int, int, int]:
    """Read blocks as pyserial gives them and write each field, without checks or losses."""
    rows, rest = 0, b""
    with serial.Serial(port, 2_000_000, timeout=1.0, exclusive=True) as link:
        _start_stream(link)
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            time.sleep(0.005)
            *lines, rest = (rest + link.read(max(1, link.in_waiting))).split(b"\n")
            values = [
                [float(field) if field else float("nan") for field in line[:-6].split(b",")[3:]]
                for line in lines
                if line.startswith(b"$S,")
            ]
            file.writelines(",".join(map(repr, row)) + "\n" for row in values)
            file.flush()
            rows += len(values)
    return rows, 0, 0


def read_with_readline(port: str, seconds: float, file: IO[str]) -> tuple[int, int, int]:
    """Read as the first page of pyserial's manual does: one line after the other."""
    rows = lost = corrupt = 0
    before: int | None = None
    with serial.Serial(port, 2_000_000, timeout=1.0, exclusive=True) as link:
        _start_stream(link)
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            line = link.readline().strip()
            if not line.startswith(b"$S,"):
                continue
            payload, _, checksum = line[1:].rpartition(b"*")
            if crc16(payload) != int(checksum, 16):
                corrupt += 1
                continue
            _, sequence, _, *fields = payload.split(b",")
            values = [float(field) if field else float("nan") for field in fields]
            lost += 0 if before is None else (int(sequence) - before - 1) % 65536
            before = int(sequence)
            rows += 1
            file.write(",".join(map(repr, values)) + "\n")
            file.flush()
    return rows, lost, corrupt


def measure(
    reader: Callable[[str, float, IO[str]], tuple[int, int, int]], port: str, seconds: float
) -> Load:
    """Run one reader for a while and return what it cost this process."""
    with tempfile.TemporaryFile("w", encoding="utf-8") as file:
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        rows, lost, corrupt = reader(port, seconds, file)
        return Load(
            rows,
            lost,
            corrupt,
            time.perf_counter() - wall_s,
            time.process_time() - cpu_s,
        )


if __name__ == "__main__":
    be_the_device()
