"""SIGTERM ends a host whose device never comes to the end of its hello."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from benchtool.bench.serial.frames import frame

WORDS = ["--rig", "pquad_single", "--z-over-r", "1", "--pwm", "1450", "--repeats", "1", "--yes"]


@pytest.mark.skipif(os.name != "posix", reason="needs SIGTERM")
@pytest.mark.parametrize("said", [b"noise\n", frame(b"H,0,protocol,2"), frame(b"H,speed,-1")])
def test_sigterm_ends_a_host_that_waits_for_the_hello(tmp_path: Path, said: bytes) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        words = ["sweep", f"tcp:127.0.0.1:{port}", *WORDS, "--out", "run"]
        with subprocess.Popen(
            [sys.executable, "-m", "benchtool", *words],
            cwd=tmp_path,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        ) as host:
            try:
                server.settimeout(60.0)
                connection, _ = server.accept()
                ended = threading.Event()
                with connection:
                    pouring = threading.Thread(target=pour, args=(connection, said, ended))
                    pouring.start()
                    assert connection.recv(100)  # the host asks
                    host.send_signal(signal.SIGTERM)
                    code = host.wait(5.0)
                    ended.set()
                    pouring.join(5.0)
            finally:
                host.kill()
    assert code != 0
    assert not (tmp_path / "run").exists()


def pour(connection: socket.socket, said: bytes, ended: threading.Event) -> None:
    """Say the same for ever."""
    while not ended.wait(0.01):
        try:
            connection.sendall(said)
        except OSError:
            return
