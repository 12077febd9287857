"""Sweeps over a real pseudo-terminal, ended from outside: kill -9, SIGINT, SIGTERM."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from benchtool.acquire.plan import plan_from_toml
from benchtool.acquire.visit_order import plan_visits
from benchtool.bench.serial.frames import frame
from benchtool.core.rig_file import load_rig_by_name
from benchtool.data.columns import word_to_code
from benchtool.data.run.append import read_events
from benchtool.data.run.read import read_points, read_samples
from benchtool.data.run.run import Run
from tests.system.served import posix, serving, start
from tests.system.served import run as command

pytestmark = posix

SMALL = ["--rig", "pquad_single", "--repeats", "2", "--z-over-r", "0.5,1", "--sample-s", "1"]


@pytest.fixture
def served(tmp_path, environment):
    """Give the address of a virtual bench, twenty times faster than life."""
    words = ["--rig", "pquad_single", "--speed", "20", "--symlink", str(tmp_path / "bench")]
    with serving("pty", environment, *words) as address:
        yield address


def begin(address: str, out: Path, environment: dict[str, str], points: int) -> subprocess.Popen:
    """Start a sweep and return it once so many points are on the disk."""
    process = start(
        ["sweep", address, *SMALL, "--yes", "--verbose", "--out", str(out)], environment
    )
    assert process.stdout is not None
    for line in process.stdout:
        if line.startswith(f"{points}/"):
            return process
    raise AssertionError(f"the sweep ended early: {process.communicate()[1]}")


def end(process: subprocess.Popen, number: signal.Signals) -> tuple[int, str]:
    process.send_signal(number)
    told = process.communicate(timeout=20)[1]
    return process.returncode, told


def planned(run: Path) -> list[int]:
    plan = plan_from_toml(Run.open(run).plan_text, "plan")
    return [visit.setting for visit in plan_visits(plan, load_rig_by_name("pquad_single"))]


@pytest.mark.real_time(deadline_s=0.1)
def test_kill_loses_no_row_and_the_run_goes_on(tmp_path, served, environment):
    run = tmp_path / "run"
    process = begin(served, run, environment, points=3)
    time.sleep(0.11)
    end(process, signal.SIGKILL)
    raw = (run / "samples.csv").read_bytes()
    samples = read_samples(run)
    assert len(samples) == raw.count(b"\n") - 1
    # 200 Hz without a gap, to the last whole row.
    steps_us = np.diff(samples.column("device_time_us"))
    assert set(steps_us) == {5000.0}
    assert len(read_points(run)) >= 3
    assert Run.open(run).metadata["state"] == "running"
    resumed = command(["sweep", "--resume", str(run), "--yes"], environment)
    assert resumed.returncode == 0, resumed.stderr
    points = read_points(run)
    assert points.column("setting").astype(int).tolist() == planned(run)
    assert points.column("point").tolist() == [float(i + 1) for i in range(len(points))]
    after = read_samples(run)
    np.testing.assert_array_equal(
        after.column("thrust_N")[: len(samples)], samples.column("thrust_N")
    )


@pytest.mark.parametrize(
    ("number", "reason"),
    [(signal.SIGINT, "stopped by Ctrl-C"), (signal.SIGTERM, "stopped by SIGTERM")],
)
def test_a_signal_ends_it_safely_and_says_so(tmp_path, served, environment, number, reason):
    run = tmp_path / "run"
    process = begin(served, run, environment, points=2)
    code, told = end(process, number)
    assert code == 5
    assert told.startswith(f"benchtool: {reason}; zero was commanded")
    facts = Run.open(run).metadata
    assert facts["state"] == "stopped"
    assert reason in facts["reason"]
    stopped = read_events(run / "events.jsonl")[-1]
    assert stopped.event == "stopped"
    assert len(read_points(run)) >= 2
    assert (run / "samples.parquet").is_file()


def test_a_signal_during_a_move_loses_no_sample_and_shows_the_end(tmp_path, served, environment):
    run = tmp_path / "run"
    process = begin(served, run, environment, points=2)
    # After a point the rotors stop and the plate moves: 1.5 s at least, 75 ms of ours.
    time.sleep(0.12)
    assert end(process, signal.SIGINT)[0] == 5
    samples = read_samples(run)
    phases = samples.column("phase")
    tail = phases == word_to_code("phase", "end")
    assert tail[-1]
    assert np.ptp(samples.column("time_s")[tail]) > 0.3
    assert samples.column("pwm1_us")[-1] == 1000.0
    steps_us = np.diff(samples.column("device_time_us"))
    lost = Run.open(run).metadata["link"]["lost"]
    assert np.round(steps_us / 5000.0 - 1.0).sum() == lost


WORDS = ["--rig", "pquad_single", "--z-over-r", "1", "--pwm", "1450", "--repeats", "1", "--yes"]


@pytest.mark.skipif(os.name != "posix", reason="needs SIGTERM")
@pytest.mark.parametrize("said", [b"noise\n", frame(b"H,0,protocol,2"), frame(b"H,speed,-1")])
def test_sigterm_ends_a_host_that_waits_for_the_hello(tmp_path, said):
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
