"""A virtual autopilot in a process of its own, and commands against it."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

COMMAND = [sys.executable, "-m", "benchtool"]


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
    """Give the address of a virtual autopilot."""
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


def run(words: list[str], environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    """Run a command to its end."""
    return subprocess.run(
        [*COMMAND, *words], capture_output=True, text=True, env=environment, timeout=90
    )
