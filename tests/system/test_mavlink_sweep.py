"""Sweeps through a virtual autopilot over UDP and a pseudo-terminal; what a killed host leaves."""

from __future__ import annotations

import signal
import subprocess
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from benchtool.core.rig_file import load_rig_by_name
from benchtool.data.run.append import read_events
from benchtool.data.run.read import read_points
from benchtool.data.run.run import Run
from benchtool.physics.model_file import load_model
from benchtool.virtual.autopilot import VirtualAutopilot
from benchtool.virtual.devices import build_hello, virtual_plant
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.links import UdpLink
from benchtool.virtual.server import BenchServer
from tests.system.served import DeviceTime, free_port, posix, run, serving, turning

SMALL = ["--rig", "pquad_single", "--repeats", "1", "--z-over-r", "0.5,1", "--sample-s", "1"]
FAST = ["--rig", "pquad_single", "--speed", "20"]


def sweep(address: str, out: Path, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    return run(["sweep", address, *SMALL, "--yes", "--out", str(out)], environment)


@pytest.mark.real_time(deadline_s=0.1)
@pytest.mark.parametrize("kind", ["ardupilot", "px4"])
def test_a_sweep_over_udp(tmp_path, environment, kind):
    link = f"mavlink:udpout:127.0.0.1:{free_port()}"
    with serving(link, environment, *FAST, "--autopilot", kind) as address:
        assert address.startswith("mavlink:udpin:127.0.0.1:")
        ended = sweep(address, tmp_path / "run", environment)
    folder = tmp_path / "run"
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
    told = [event.text for event in read_events(folder / "events.jsonl")]
    assert f"rotor 1 is driven by output {3 if kind == 'ardupilot' else 1}" in told


class Watched(VirtualAutopilot):
    """Note when something was heard last and when motors stood, in its own time."""

    heard_s = stood_s = 0.0

    def receive(self, data: bytes, now_s: float) -> bytes:
        self.heard_s = now_s if data else self.heard_s
        return super().receive(data, now_s)

    def tick(self, n: int, now_s: float) -> tuple[bytes, list[bytes]]:
        told = super().tick(n, now_s)
        if max(self.outputs_us) > 1000:
            self.stood_s = 0.0
        else:
            self.stood_s = self.stood_s or now_s
        return told


@posix
@pytest.mark.parametrize("kind", ["ardupilot", "px4"])
def test_a_killed_host_leaves_motors_standing_within_300_ms(kind):
    rig = load_rig_by_name("pquad_single")
    truth = load_model("single", rig).model
    plant = virtual_plant(rig, truth, 1)
    clock = DeviceTime()
    device = Watched(Firmware(plant, build_hello(plant, truth, 1), clock()), kind)
    port = free_port()
    link = UdpLink("127.0.0.1", port, listen=False)
    server = BenchServer(device, link, lambda: plant.rate_Hz, clock=clock)
    ended = threading.Event()
    thread = threading.Thread(
        target=server.run, args=(lambda: not ended.is_set(), 0.001), daemon=True
    )
    thread.start()
    try:
        with turning(f"mavlink:udpin:127.0.0.1:{port}?rotors=1&system=1", 1400.0) as host:
            time.sleep(0.5)
            assert 1400 in device.outputs_us
            host.send_signal(signal.SIGKILL)
            until_s = time.monotonic() + 10.0
            while not device.stood_s and time.monotonic() < until_s:
                time.sleep(0.001)
            assert device.stood_s - device.heard_s < 0.3
    finally:
        ended.set()
        thread.join(5.0)
        link.close()
