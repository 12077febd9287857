"""The shipped bridge script itself, run by node as the GUI runs it, over UDP."""

from __future__ import annotations

import math
import os
import signal
import socket
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from benchtool.bench.bench import Bench
from benchtool.bench.drivers import open_bench
from benchtool.bench.rcbenchmark.lines import RAMP_MS, SILENCE_MS, BridgeDecoder
from benchtool.core.errors import CommandRefused, DeviceStopped, LinkLost
from benchtool.data.run.read import read_points
from benchtool.data.run.run import Run
from benchtool.physics.model_file import load_model
from benchtool.virtual.bridge import VirtualBridge
from benchtool.virtual.devices import hello_of, virtual_plant
from benchtool.virtual.firmware import Firmware
from tests.rcb.stand import RIG, Stand, gui, needs_node
from tests.system.served import environment_of, run

pytestmark = needs_node
LOWEST_US = 1000.0

STATED_S = 1e-3 * (SILENCE_MS + RAMP_MS) + 0.05
"""What the how-to page states, with two ticks of the script's timer; nothing for busy machines."""

BUSY_S = 0.5
"""Given to a machine that runs other tests at the same time, where only wall time can be read."""


def lasting(stand: Stand, pulse_us: float, longest_s: float = 5.0) -> float:
    """Wait until the output holds a pulse; return when it began to."""
    until_s = time.monotonic() + longest_s
    while time.monotonic() < until_s:
        if stand.outputs and stand.outputs[-1][1] == pulse_us:
            return stand.outputs[-1][0]
        time.sleep(0.01)
    raise AssertionError(f"the output never held {pulse_us}: {stand.outputs[-5:]}")


def read_on(bench: Bench) -> None:
    """Read for ten seconds, or until something ends it."""
    for _ in range(100):
        bench.read(0.1)


@pytest.mark.real_time(deadline_s=0.1)
def test_a_bench_behind_the_script(tmp_path: Path) -> None:
    with gui(tmp_path) as (address, stand), open_bench(address) as bench:
        identity = bench.identity
        assert identity.device_id == "rcb-virtual-stand"
        assert identity.limits["pwm_us"] == 1950.0
        assert identity.watchdog_s == 1e-3 * SILENCE_MS
        assert [channel.name for channel in identity.channels][:2] == ["pwm1_us", "thrust_N"]
        assert identity.rate_Hz == pytest.approx(50.0, rel=0.02)
        bench.set_pwm(np.array([1400.0]))
        until_s = bench.now_s() + 1.5
        parts = [bench.read(0.1).values for _ in range(100) if bench.now_s() < until_s]
        names = [channel.name for channel in identity.channels]
        last = np.concatenate(parts)[-1]
        assert last[names.index("pwm1_us")] == 1400.0
        assert last[names.index("rpm1")] > 2000.0
        assert last[names.index("thrust_N")] > 1.0
        with pytest.raises(CommandRefused, match="from 1000 to 1950 us"):
            bench.set_pwm(np.array([2200.0]))
        with pytest.raises(CommandRefused, match="the motor turns; stop it first"):
            bench.tare()
        bench.stop()
        assert stand.outputs[-1][1] == LOWEST_US
        bench.tare()
    assert [us for _, us in stand.outputs] == [1000.0, 1400.0, 1000.0]


SPIN = """
import sys
import numpy as np
from benchtool.bench.drivers import open_bench
from benchtool.bench.bench import Bench
from benchtool.virtual.firmware import Firmware
with open_bench(sys.argv[1]) as bench:
    bench.set_pwm(np.array([1500.0]))
    print("turning", flush=True)
    while True:
        bench.read(0.05)
"""


@pytest.mark.skipif(os.name != "posix", reason="needs signals")
def test_a_killed_host_leaves_the_lowest_pulse_within_the_stated_time(tmp_path: Path) -> None:
    with gui(tmp_path) as (address, stand):
        host = subprocess.Popen(
            [sys.executable, "-c", SPIN, address], stdout=subprocess.PIPE, text=True
        )
        try:
            assert host.stdout is not None
            assert host.stdout.readline() == "turning\n"
            time.sleep(0.4)
            assert stand.outputs[-1][1] == 1500.0
            host.send_signal(signal.SIGKILL)
            killed_s = time.monotonic()
            stood_s = lasting(stand, LOWEST_US)
        finally:
            host.kill()
            host.communicate()
        assert stood_s - killed_s < STATED_S + BUSY_S
        # It is a ramp: pulses fall one after another, from the last to the lowest.
        falling = [us for at_s, us in stand.outputs if at_s > killed_s]
        assert len(falling) > 8
        assert falling == sorted(falling, reverse=True)
        first_s = next(at_s for at_s, _ in stand.outputs if at_s > killed_s)
        assert stood_s - first_s == pytest.approx(1e-3 * RAMP_MS, abs=0.1)
        assert any("watchdog: no word for" in text for text in stand.said)
        # A host that comes later finds a motor that stands, and can go on.
        with open_bench(address) as bench:
            bench.set_pwm(np.array([1200.0]))
            lasting(stand, 1200.0)


def test_the_host_is_told_why_the_script_stopped(tmp_path: Path) -> None:
    with gui(tmp_path) as (address, stand), open_bench(address) as bench:
        bench.set_pwm(np.array([1300.0]))
        time.sleep(1e-3 * (SILENCE_MS + RAMP_MS) + 0.2)
        lasting(stand, LOWEST_US)
        with pytest.raises(DeviceStopped, match=r"watchdog: no word for \d+ ms; motor stopped"):
            bench.set_pwm(np.array([1300.0]))


def test_a_limit_stops_at_once(tmp_path: Path) -> None:
    with gui(tmp_path, speed=10.0) as (address, stand), open_bench(address) as bench:
        # Far from the plate 9 N are reached, this near 12.8.
        bench.move_plate(0.055)
        bench.set_pwm(np.array([1940.0]))
        with pytest.raises(DeviceStopped, match="limit: thrust_N 1"):
            read_on(bench)
        lasting(stand, LOWEST_US)
        falling = [us for _, us in stand.outputs]
        assert falling == [1000.0, 1940.0, 1000.0]


def test_a_stand_that_falls_silent_is_stopped_and_lost(tmp_path: Path) -> None:
    with gui(tmp_path) as (address, stand), open_bench(address) as bench:
        bench.set_pwm(np.array([1300.0]))
        stand.silent = True
        with pytest.raises((LinkLost, DeviceStopped), match="no reading for"):
            read_on(bench)
        lasting(stand, LOWEST_US)


def test_a_script_that_is_stopped_puts_nothing_out_again(tmp_path: Path) -> None:
    with gui(tmp_path) as (address, stand), open_bench(address) as bench:
        bench.set_pwm(np.array([1300.0]))
        stand.tell(stop=True)
        with pytest.raises(LinkLost, match="look at the GUI and at the motor"):
            read_on(bench)
        assert stand.ended
        assert math.isnan(stand.outputs[-1][1])


@pytest.mark.real_time(deadline_s=0.1)
def test_the_series_1780_has_another_output(tmp_path: Path) -> None:
    with gui(tmp_path, version="Series 1780") as (address, stand):
        with open_bench(address) as bench:
            assert bench.identity.facts["output"] == "escA"
            assert not bench.identity.simulated
        assert stand.outputs[0][1] == LOWEST_US


@pytest.mark.real_time(deadline_s=0.1)
def test_a_sweep_through_the_script(tmp_path: Path) -> None:
    words = ["--rig", "pquad_single", "--repeats", "1", "--z-over-r", "0.5,1", "--sample-s", "1"]
    out = tmp_path / "run"
    with gui(tmp_path, speed=10.0) as (address, stand):
        ended = run(
            ["sweep", address, *words, "--yes", "--out", str(out)], environment_of(tmp_path)
        )
        assert ended.returncode == 0, ended.stderr
        assert stand.outputs[-1][1] == LOWEST_US
    points = read_points(out)
    thrust_N = points.column("thrust_N")
    near, far = points.column("plate_z_m") < 0.07, points.column("plate_z_m") > 1.0
    pulse = points.column("pwm1_us") == 1590.0
    # In ground effect at z/R = 0.5 thrust is a third above that far away, as on every bench.
    assert thrust_N[near & pulse].mean() / thrust_N[far & pulse].mean() == pytest.approx(
        1.33, abs=0.03
    )
    facts = Run.open(out).metadata
    assert facts["state"] == "ended"
    assert facts["simulated"] is True
    assert facts["device"]["protocol"] == "rcbudp-1"


@pytest.mark.real_time(deadline_s=0.1)
def test_script_and_imitation_say_the_same(tmp_path: Path) -> None:
    truth = load_model("single", RIG).model
    plant = virtual_plant(RIG, truth, 3)
    imitated = VirtualBridge(Firmware(plant, hello_of(plant, truth, 3)))
    conversation = [b"hello", b"2200", b"1300", b"tare", b"stop", b"tare", b"clear", b"average 2"]
    keys = ("to", "refused", "us", "why", "low_us", "high_us", "silence_ms", "limits", "output")

    def told(entry: dict) -> dict:
        return {key: entry[key] for key in keys if key in entry}

    with gui(tmp_path) as (address, _):
        listen = int(address.rpartition(":")[2].partition("?")[0])
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
            own.bind(("127.0.0.1", int(address.rpartition("=")[2])))
            own.settimeout(5.0)
            for word in conversation:
                own.sendto(word, ("127.0.0.1", listen))
                answer: dict = {}
                while answer.get("to") != word.decode():
                    for line in BridgeDecoder().feed(own.recv(65536)):
                        answer = asdict(line.entry)
                (ours,) = BridgeDecoder().feed(imitated.receive(word, 0.0))
                assert told(answer) == told(asdict(ours.entry)), word
