"""Virtual benches in processes of their own, hosts beside them, and a device's own time."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

COMMAND = [sys.executable, "-m", "benchtool"]
posix = pytest.mark.skipif(os.name != "posix", reason="needs pseudo-terminals and signals")

SPIN = """
import sys
import numpy as np
from benchtool.bench.drivers import open_bench
with open_bench(sys.argv[1]) as bench:
    bench.set_pwm(np.full(bench.identity.n_rotors, float(sys.argv[2])))
    print("turning", flush=True)
    while True:
        bench.read(0.05)
"""


def environment_of(folder: Path) -> dict[str, str]:
    """Give the environment of commands that remember nothing outside of a folder."""
    return {**os.environ, "BENCHTOOL_STATE": str(folder / "state"), "PYTHONUNBUFFERED": "1"}


def free_port() -> int:
    """Give a UDP port that nobody listens on."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def serving(link: str, environment: dict[str, str], *more: str) -> Iterator[str]:
    """Give the address of a virtual bench or autopilot."""
    process = subprocess.Popen(
        [*COMMAND, "bench", "serve", "--link", link, *more],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=environment,
    )
    assert process.stdout is not None
    try:
        yield process.stdout.readline().strip()
    finally:
        process.terminate()
        process.wait(10)
        process.stdout.close()


def start(words: list[str], environment: dict[str, str]) -> subprocess.Popen[str]:
    """Start a command that Ctrl-C ends, also where a shell lets it ignore that."""
    return subprocess.Popen(
        [*COMMAND, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )


def run(words: list[str], environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    """Run a command to its end."""
    return subprocess.run(
        [*COMMAND, *words], capture_output=True, text=True, env=environment, timeout=90
    )


@contextmanager
def turning(address: str, pulse_us: float) -> Iterator[subprocess.Popen[str]]:
    """Give a host in a process of its own that turns motors until it is killed."""
    host = subprocess.Popen(
        [sys.executable, "-c", SPIN, address, str(pulse_us)], stdout=subprocess.PIPE, text=True
    )
    try:
        assert host.stdout is not None
        assert host.stdout.readline() == "turning\n"
        yield host
    finally:
        host.kill()
        host.communicate()


class DeviceTime:
    """Give the time of a device in this process: it stands still while the process does.

    At most 20 ms pass between two looks at it, as on a microcontroller whose loop never waits; so
    what a watchdog is seen to do does not depend on how busy this machine is.
    """

    def __init__(self) -> None:
        self._wall_s = self._now_s = time.monotonic()

    def __call__(self) -> float:
        wall_s = time.monotonic()
        self._now_s += min(wall_s - self._wall_s, 0.020)
        self._wall_s = wall_s
        return self._now_s
