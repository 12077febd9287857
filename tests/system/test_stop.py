"""`benchtool stop` from a second process: zero at the device, and the standstill as measured."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import pytest

from benchtool.data.run.run import Run
from tests.system.served import posix, run, serving, start

pytestmark = posix


@pytest.fixture
def runs(tmp_path):
    return tmp_path / "runs"


def sweep_words(address: str, out: Path) -> list[str]:
    options = "--rig pquad_single --repeats 9 --z-over-r 1 --pwm 1450 --sample-s 2 --yes --out"
    return ["sweep", address, *options.split(), str(out)]


def test_every_bench_of_this_user_is_stopped(tmp_path, runs, environment):
    links = [str(tmp_path / name) for name in ("a", "b")]
    rig = ("--rig", "pquad_single")
    with (
        serving("pty", environment, *rig, "--symlink", links[0]) as first,
        serving("pty", environment, *rig, "--symlink", links[1]) as second,
    ):
        addresses = [first, second]
        sweeps = [
            start(sweep_words(address, runs / name), environment)
            for address, name in zip(addresses, "ab", strict=True)
        ]
        for sweep in sweeps:
            assert sweep.stdout is not None
            next(line for line in sweep.stdout if line.startswith("1/"))
        missing = run(["stop", "--address", "serial:none"], environment)
        assert missing.returncode == 2
        assert all(address in missing.stderr for address in addresses)
        stopped = run(["stop", "--address", first], environment)
        assert (stopped.returncode, stopped.stderr) == (0, "")
        assert stopped.stdout.startswith(f"{first}: rotor 1 was seen to stand")
        assert sweeps[0].wait(20) == 5
        assert sweeps[1].poll() is None
        stopped = run(["stop"], environment)
        assert stopped.stdout.startswith(f"{second}: rotor 1 was seen to stand")
        assert sweeps[1].wait(20) == 5
    for sweep, name in zip(sweeps, "ab", strict=True):
        assert "stopped by benchtool stop" in sweep.communicate()[1]
        assert "stopped by benchtool stop" in Run.open(runs / name).metadata["reason"]


def test_no_bench_is_no_success(environment):
    found = run(["stop"], environment)
    assert found.returncode == 2
    assert environment["BENCHTOOL_STATE"] in found.stderr


def test_a_run_that_was_killed_is_reported_once(tmp_path, runs, environment):
    folder = Path(environment["BENCHTOOL_STATE"]) / "stop"
    with serving("pty", environment, "--rig", "pquad_single", "--symlink", str(tmp_path / "a")) as (
        address
    ):
        sweep = start(sweep_words(address, runs / "a"), environment)
        assert sweep.stdout is not None
        next(line for line in sweep.stdout if line.startswith("run "))
        (file,) = folder.glob("*.json")
        assert json.loads(file.read_text())["address"] == address
        assert file.stat().st_mode & 0o077 == 0
        sweep.send_signal(signal.SIGKILL)
        sweep.communicate()
    (folder / "cut.json").write_text('{"address": "tc')
    found = run(["stop"], environment)
    (folder / "cut.json").unlink()
    assert (found.returncode, found.stdout) == (
        8,
        f"{address}: its process has ended; standstill not confirmed\n",
    )
    assert address in found.stderr
    assert not list(folder.glob("*.json"))
