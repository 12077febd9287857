"""Campaigns on a real Dask scheduler with real workers, each of which is killed in turn."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pyarrow.parquet as pq
import pytest

pytest.importorskip("distributed", reason="no Dask: pip install benchtool[cluster]")
pytestmark = pytest.mark.slow

CAMPAIGN = ("simulate", "pitch", "--vary", "K_b=1.5:2.5:20", "--seeds", "40",
            "--controllers", "pid")  # fmt: skip
RUNS = 800
ROOT = Path(__file__).parents[2]


class Cluster:
    """A scheduler and workers, each a process of its own."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.processes: list[subprocess.Popen[bytes]] = []
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.address = f"tcp://127.0.0.1:{free.getsockname()[1]}"

    def _start(self, module: str, *words: str) -> subprocess.Popen[bytes]:
        log = (self._folder / f"{len(self.processes)}.log").open("wb")
        process = subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.{module}", *words, "--no-dashboard"],
            stdout=log, stderr=log, cwd=self._folder, env=os.environ | {"PYTHONPATH": str(ROOT)},
        )  # fmt: skip
        log.close()
        self.processes.append(process)
        return process

    def scheduler(self) -> subprocess.Popen[bytes]:
        return self._start("dask_scheduler", "--host", self.address)

    def listens(self) -> bool:
        host, port = self.address.removeprefix("tcp://").split(":")
        with suppress(OSError), socket.create_connection((host, int(port)), 1.0):
            return True
        return False

    def worker(self) -> subprocess.Popen[bytes]:
        return self._start("dask_worker", self.address, "--nthreads", "1", "--no-nanny")


@pytest.fixture
def cluster(tmp_path):
    one = Cluster(tmp_path)
    yield one
    for process in one.processes:
        process.kill()
        process.wait()


def client(*words: object, **more: str) -> subprocess.Popen[str]:
    return command(*CAMPAIGN, *words, **more)


def command(*words: object, cwd: Path | None = None, **more: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "benchtool", *map(str, words)],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=os.environ | more, cwd=cwd,
    )  # fmt: skip


def wait(for_what: Callable[[], bool], seconds: float = 60.0) -> None:
    deadline = time.monotonic() + seconds
    while not for_what():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def blocks(out: Path) -> int:
    path = out / "runs.jsonl"
    return path.read_bytes().count(b"\n") - 1 if path.exists() else 0


def test_whoever_is_killed_no_finished_block_is_lost(cluster, tmp_path):
    scheduler = cluster.scheduler()
    first = cluster.worker()
    out = tmp_path / "out"
    words = ("--cluster", cluster.address, "--out", out)
    # A worker dies, and the scheduler after it.
    running = client(*words)
    wait(lambda: blocks(out) >= 2)
    first.send_signal(signal.SIGKILL)
    cluster.worker()
    stored = blocks(out)
    wait(lambda: blocks(out) > stored)
    scheduler.kill()
    said, _ = running.communicate(timeout=90)
    assert running.returncode == 3
    assert "repeat the command" in said
    assert "Traceback" not in said
    assert 0 < blocks(out) < RUNS // 50
    # The client dies.
    cluster.address = Cluster(tmp_path).address
    cluster.scheduler()
    cluster.worker()
    stored = blocks(out)
    words = ("--cluster", cluster.address, "--out", out)
    running = client(*words)
    wait(lambda: blocks(out) > stored)
    running.kill()
    running.communicate()
    stored = blocks(out)
    before = (out / "runs.jsonl").read_bytes()
    assert 0 < stored < RUNS // 50
    # Another campaign does not take these blocks.
    other = client(*words, "--gains", "stiff")
    said, _ = other.communicate(timeout=60)
    assert other.returncode == 2
    assert "results of other work" in said
    assert (out / "runs.jsonl").read_bytes() == before
    # What is missing is run, and the table is that of one process.
    running = client(*words)
    said, _ = running.communicate(timeout=120)
    assert running.returncode == 0, said
    alone = client("--out", tmp_path / "alone")
    alone.communicate(timeout=60)
    found, truth = (
        pq.read_table(folder / "campaign.parquet") for folder in (out, tmp_path / "alone")
    )
    assert found.num_rows == RUNS
    assert found.equals(truth)
    assert not (out / "runs.jsonl").exists()


def test_a_campaign_of_this_machine_resumes_too(tmp_path):
    running = client("--out", tmp_path)
    wait(lambda: blocks(tmp_path) >= 2)
    running.kill()
    running.communicate()
    assert 0 < blocks(tmp_path) < RUNS // 50
    running = client("--out", tmp_path)
    said, _ = running.communicate(timeout=60)
    assert running.returncode == 0, said
    assert pq.read_table(tmp_path / "campaign.parquet").num_rows == RUNS


def test_no_scheduler_is_one_sentence(tmp_path):
    address = Cluster(tmp_path).address
    running = client("--cluster", address, "--out", tmp_path / "out", BENCHTOOL_DEBUG="")
    said, _ = running.communicate(timeout=60)
    assert running.returncode == 2
    assert f"no Dask scheduler at {address}" in said
    assert not (tmp_path / "out").exists()
