"""Sweeps through a virtual autopilot over UDP and a pseudo-terminal; what a killed host leaves."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from benchtool.bench.firmware import Firmware
from benchtool.bench.server import BenchServer
from benchtool.bench.udp_link import UdpLink
from benchtool.bench.virtual_autopilot import VirtualAutopilot
from benchtool.bench.virtual_device import hello_of, virtual_plant
from benchtool.library import load_model, rig_named
from benchtool.store import Run, read_events, read_points, read_samples
from tests.system.mavlink_served import environment_of, free_port, run, serving

SMALL = ["--rig", "pquad_single", "--repeats", "1", "--z-over-r", "0.5,1", "--sample-s", "1"]
FAST = ["--rig", "pquad_single", "--speed", "20"]
posix = pytest.mark.skipif(os.name != "posix", reason="needs pseudo-terminals or signals")


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    return environment_of(tmp_path)


def sweep(address: str, out: Path, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    return run(["sweep", address, *SMALL, "--yes", "--out", str(out)], environment)


def check_swept(ended: subprocess.CompletedProcess[str], folder: Path) -> None:
    assert ended.returncode == 0, ended.stderr
    points = read_points(folder)
    assert f"{int(points.column('point').max())} points (simulated)" in ended.stdout
    thrust_N = points.column("thrust_N")
    assert np.nanmax(thrust_N) > 4.0
    near = points.column("plate_z_m") < 0.07
    # In ground effect at z/R = 0.5 thrust is a third above that far away, as on every bench.
    pulse = points.column("pwm1_us") == 1590.0
    far = points.column("plate_z_m") > 1.0
    ratio = thrust_N[near & pulse].mean() / thrust_N[far & pulse].mean()
    assert ratio == pytest.approx(1.33, abs=0.02)
    facts = Run.open(folder).metadata
    assert facts["state"] == "ended"
    assert facts["simulated"] is True
    assert facts["device"]["protocol"] == "MAVLink 2"


@pytest.mark.parametrize("kind", ["ardupilot", "px4"])
def test_a_sweep_over_udp(tmp_path: Path, environment: dict[str, str], kind: str) -> None:
    link = f"mavlink:udpout:127.0.0.1:{free_port()}"
    with serving(link, environment, *FAST, "--autopilot", kind) as address:
        assert address.startswith("mavlink:udpin:127.0.0.1:")
        ended = sweep(address, tmp_path / "run", environment)
    check_swept(ended, tmp_path / "run")
    told = [event.text for event in read_events(tmp_path / "run" / "events.jsonl")]
    assert f"rotor 1 hangs on output {3 if kind == 'ardupilot' else 1}" in told


@posix
def test_a_sweep_over_a_pseudo_terminal(tmp_path: Path, environment: dict[str, str]) -> None:
    with serving("mavlink:pty", environment, *FAST, "--symlink", str(tmp_path / "fc")) as address:
        assert address == f"mavlink:serial:{tmp_path / 'fc'}:115200?rotors=1"
        ended = sweep(address, tmp_path / "run", environment)
    check_swept(ended, tmp_path / "run")
    samples = read_samples(tmp_path / "run")
    assert np.all(np.diff(samples.column("time_s")) > 0.0)


SPIN = """
import sys
import numpy as np
from benchtool.bench.address import open_bench
with open_bench(sys.argv[1]) as bench:
    bench.set_pwm(np.array([1400.0]))
    print("turning", flush=True)
    while True:
        bench.read(0.05)
"""


@posix
@pytest.mark.parametrize("kind", ["ardupilot", "px4"])
def test_a_killed_host_leaves_motors_standing_within_300_ms(kind: str) -> None:
    rig = rig_named("pquad_single")
    truth = load_model("single", rig).model
    plant = virtual_plant(rig, truth, 1)
    device = VirtualAutopilot(Firmware(plant, hello_of(plant, truth, 1)), kind)
    port = free_port()
    link = UdpLink("127.0.0.1", port, listen=False)
    server = BenchServer(device, link, lambda: plant.rate_Hz)
    ended = threading.Event()
    thread = threading.Thread(
        target=server.run, args=(lambda: not ended.is_set(), 0.001), daemon=True
    )
    thread.start()
    host = subprocess.Popen(
        [sys.executable, "-c", SPIN, f"mavlink:udpin:127.0.0.1:{port}?rotors=1&system=1"],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert host.stdout is not None
        assert host.stdout.readline() == "turning\n"
        time.sleep(0.5)
        assert 1400 in device.outputs_us
        host.send_signal(signal.SIGKILL)
        killed_s = time.monotonic()
        while max(device.outputs_us) > 1000 and time.monotonic() < killed_s + 2.0:
            time.sleep(0.001)
        assert time.monotonic() - killed_s < 0.3
    finally:
        host.kill()
        host.communicate()
        ended.set()
        thread.join(5.0)
        link.close()
