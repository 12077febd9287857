"""Pitch experiments over a real link: a device in a process of its own, its recorder in another."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from pathlib import Path

import numpy as np
import pytest

from benchtool.bench.drivers import open_bench
from benchtool.data.run.append import read_events
from benchtool.data.run.read import read_pitch, read_samples
from benchtool.data.run.run import Run
from tests.system.served import COMMAND, posix, start
from tests.system.served import serving as serving_bench

PITCH = ["--rig", "pquad", "--mode", "pitch", "--seed", "3"]


def serving(
    environment: dict[str, str], *more: str, link: str = "pty"
) -> AbstractContextManager[str]:
    """Give the address of a virtual pitch bench, ten times faster than life."""
    return serving_bench(link, environment, *PITCH, "--speed", "10", *more)


def recording(address: str, out: Path, environment: dict[str, str], *more: str) -> subprocess.Popen:
    words = ["record", address, "--rig", "pquad", "--yes", "--out", str(out), *more]
    return start(words, environment)


def wait_for_samples(run: Path, count: int, also: Callable[[], bool] = lambda: True) -> None:
    """Wait until a recording has at least so many samples on the disk, and something else holds."""
    until_s = time.monotonic() + 60.0
    while time.monotonic() < until_s:
        samples = run / "samples.csv"
        if samples.is_file() and samples.read_bytes().count(b"\n") > count and also():
            return
        time.sleep(0.02)
    raise AssertionError("the recording never came so far")


def pulses_now(address: str) -> np.ndarray:
    """Return every pulse that a bench shows when somebody else listens to it (m, 4)."""
    with open_bench(address) as bench:
        names = [channel.name for channel in bench.identity.channels]
        values = bench.read(0.5).values
    shown: np.ndarray = values[:, [names.index(f"pwm{k}_us") for k in range(1, 5)]]
    assert len(shown)
    return shown


def overheard(address: str, seconds: float) -> list[bytes]:
    """Return the whole lines that a device says to nobody, without a word to it."""
    port = os.open(address.removeprefix("serial:"), os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
    heard, until_s = b"", time.monotonic() + seconds
    try:
        while time.monotonic() < until_s:
            with suppress(BlockingIOError):
                heard += os.read(port, 65536)
            time.sleep(0.005)
    finally:
        os.close(port)
    return heard.split(b"\n")[1:-1]


@pytest.mark.real_time(deadline_s=0.1)
@pytest.mark.parametrize("link", [pytest.param("pty", marks=posix), "tcp:127.0.0.1:0"])
def test_a_whole_schedule_over_a_link(tmp_path, environment, link):
    run = tmp_path / "run"
    with serving(environment, link=link) as address:
        ended = recording(address, run, environment, "--seconds", "25", "--schedule", "plate")
        told, complained = ended.communicate(timeout=60)
    assert ended.returncode == 0, complained
    assert "RMS error" in told
    facts = Run.open(run).metadata
    assert facts["state"] == "ended"
    assert facts["simulated"]
    assert facts["link"]["lost"] == 0
    assert facts["device"]["facts"]["schedule"] == "plate"
    recorded = read_pitch(run)
    assert len(recorded) == pytest.approx(25 * 250, rel=0.02)
    assert np.diff(recorded.column("time_s")) == pytest.approx(0.004)
    time_s, theta = recorded.column("time_s"), np.degrees(recorded.column("theta_rad"))
    assert np.abs(theta[time_s < 8.0]).max() < 0.1
    # A plate under the front rotor at z/R = 2, under the soft PID (docs: -1.58 degrees).
    assert theta[time_s > 15.0].mean() == pytest.approx(-1.57, abs=0.05)
    assert np.nanmin(recorded.column("plate_z_m")) == pytest.approx(0.24)


@posix
def test_a_killed_recorder_leaves_motors_at_zero(tmp_path, environment):
    run = tmp_path / "run"
    with serving(environment) as address:
        process = recording(address, run, environment)
        wait_for_samples(run, 500, lambda: read_samples(run).column("pwm1_us")[-1] > 1500.0)
        process.kill()
        process.communicate()
        lines = overheard(address, 1.5)
    # Nobody has sent the device a word since, so only its watchdog can have stopped the motors.
    assert any(line.startswith(b"$E,watchdog,no line for 2") for line in lines)
    sample = [line.split(b",") for line in lines if line.startswith(b"$S,")][-1]
    assert [float(field) for field in sample[6:10]] == [1000.0] * 4  # after three channels
    samples = read_samples(run)
    assert samples.column("pwm1_us")[-1] > 1500.0
    assert set(np.diff(samples.column("device_time_us"))) == {4000.0}
    assert Run.open(run).metadata["state"] == "running"


@posix
@pytest.mark.parametrize(
    ("number", "reason"),
    [(signal.SIGINT, "stopped by Ctrl-C"), (signal.SIGTERM, "stopped by SIGTERM")],
)
def test_a_signal_ends_it_safely(tmp_path, environment, number, reason):
    run = tmp_path / "run"
    with serving(environment) as address:
        process = recording(address, run, environment)
        wait_for_samples(run, 500)
        process.send_signal(number)
        _, complained = process.communicate(timeout=20)
        assert (pulses_now(address) == 1000.0).all()
    assert process.returncode == 5
    assert complained.startswith(f"benchtool: {reason}; zero was commanded")
    assert Run.open(run).metadata["state"] == "stopped"
    assert read_events(run / "events.jsonl")[-1].event == "stopped"
    assert (run / "samples.parquet").is_file()
    samples = read_samples(run)
    assert set(np.diff(samples.column("device_time_us"))) == {4000.0}
    assert samples.column("pwm1_us")[-1] == 1000.0


@posix
def test_a_silent_link_and_a_beam_that_turns_too_far_end_it(tmp_path, environment):
    for name, faults, options, code, told in (
        ("silent", ["--fault", "silence:at_s=1,for_s=30"], [], 8, "not seen to stand"),
        ("far", [], ["--limit-deg", "1"], 4, "theta_rad"),
    ):
        run = tmp_path / name
        with serving(environment, *faults) as address:
            process = recording(address, run, environment, *options)
            _, complained = process.communicate(timeout=40)
        assert process.returncode == code, complained
        assert told in complained
        assert complained.count("\n") == 1
        assert told in Run.open(run).metadata["reason"]


def test_nobody_arms_a_bench_without_a_word(tmp_path, environment):
    def answered(word: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [*COMMAND, "record", "sim:pquad?mode=pitch", "--out", "run", "--seconds", "1"],
            input=word,
            capture_output=True,
            text=True,
            env=environment,
            cwd=tmp_path,
            timeout=60,
        )

    assert answered("yes\n").returncode == 5
    assert answered("").returncode == 2
    assert not (tmp_path / "run").exists()
    armed = answered("ARM\n")
    assert armed.returncode == 0, armed.stderr
    assert answered("ARM\n").returncode == 2
    assert (tmp_path / "run" / "samples.parquet").is_file()
