"""The GUI under node with the shipped script in it, in front of simulated physics."""

from __future__ import annotations

import json
import os
import queue
import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchtool.bench.rcbenchmark.lines import bridge_text
from benchtool.core.errors import BenchtoolError
from benchtool.core.rig_file import rig_named
from benchtool.physics.model_file import load_model
from benchtool.virtual.bridge import VIRTUAL_1580, StandReadings
from benchtool.virtual.devices import virtual_plant

GUI = Path(__file__).with_name("gui.js")
RIG = rig_named("pquad_single")
NAP_S = 0.005

needs_node = pytest.mark.skipif(shutil.which("node") is None, reason="needs node")


class Stand:
    """Step the plant, feed the GUI with readings, and note what it puts out.

    Attributes:
        outputs: (wall time s, pulse us) of every change; nan where the output was switched off.
        said: what the script printed.
    """

    def __init__(self, process: subprocess.Popen[str], speed: float, rate_Hz: float) -> None:
        self.outputs: list[tuple[float, float]] = []
        self.said: list[str] = []
        self.ended = False
        self.silent = False
        self.plant = virtual_plant(RIG, load_model("single", RIG).model, 3, rate_Hz=rate_Hz)
        self.plant.command_pwm(np.array([RIG.propulsion.pwm_stop_us]))
        self.ready = threading.Event()
        self._process, self._speed = process, speed
        names = tuple(channel.name for channel in self.plant.channels)
        self._readings = StandReadings(names, speed)
        self._told: queue.Queue[dict[str, Any]] = queue.Queue()
        self._closing = False
        self._tick = 0
        self._threads = [
            threading.Thread(target=work, daemon=True) for work in (self._hear, self._run)
        ]
        for thread in self._threads:
            thread.start()

    def tell(self, **what: object) -> None:
        """Say a line to the GUI."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(what) + "\n")
        self._process.stdin.flush()

    def close(self) -> None:
        """End physics and GUI."""
        self._closing = True
        self._threads[1].join(5.0)
        self._process.kill()
        self._process.wait(5.0)
        self._threads[0].join(5.0)

    def _hear(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            told = json.loads(line)
            at_s = time.monotonic()
            if "us" in told:
                self.outputs.append((at_s, float(told["us"])))
            elif "off" in told:
                self.outputs.append((at_s, float("nan")))
            elif "print" in told:
                self.said.append(told["print"])
            elif "ended" in told:
                self.ended = True
            self._told.put(told)
            if "ready" in told:
                self.ready.set()

    def _obey(self, told: dict[str, Any]) -> None:
        stop_us = RIG.propulsion.pwm_stop_us
        if "us" in told or "off" in told:
            self.plant.command_pwm(np.array([float(told.get("us", stop_us))]))
        elif "tare" in told:
            self.plant.tare()
            self.tell(tared=True)
        elif "place" in told:
            try:
                self.plant.command_plate(*map(float, told["place"].split()))
                self.tell(placed="")
            except BenchtoolError as error:
                self.tell(placed=str(error))

    def _run(self) -> None:
        last_s, owed = time.monotonic(), 0.0
        try:
            while not self._closing:
                time.sleep(NAP_S)
                while not self._told.empty():
                    self._obey(self._told.get())
                now_s = time.monotonic()
                owed += min(now_s - last_s, 0.5) * self._speed * self.plant.rate_Hz
                last_s = now_s
                n, owed = int(owed), owed % 1.0
                for row in self.plant.advance(n).tolist() if n else []:
                    self._tick += 1
                    time_us = round(1e6 * self._tick / self.plant.rate_Hz)
                    if not self.silent:
                        moving = self.plant.plate_moving
                        self.tell(result=self._readings.result(time_us, row, moving))
        except OSError:
            pass  # The GUI is gone.


def free_ports() -> tuple[int, int]:
    """Give two UDP ports that nobody listens on."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as two,
    ):
        for opened in (one, two):
            opened.bind(("127.0.0.1", 0))
        return one.getsockname()[1], two.getsockname()[1]


@contextmanager
def gui(
    folder: Path, speed: float = 1.0, rate_Hz: float = 50.0, version: str = VIRTUAL_1580
) -> Iterator[tuple[str, Stand]]:
    """Give the address of a GUI that runs the bridge script, and the stand behind it."""
    listen, host = free_ports()
    script = folder / "bridge.js"
    script.write_text(bridge_text(RIG, listen_port=listen, host_port=host), encoding="utf-8")
    process = subprocess.Popen(
        ["node", str(GUI), str(script), version],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"NODE_OPTIONS": ""},
    )
    stand = Stand(process, speed, rate_Hz)
    try:
        assert stand.ready.wait(20.0), "the script did not start"
        yield f"rcbudp:127.0.0.1:{listen}?listen={host}", stand
    finally:
        stand.close()
        for pipe in (process.stdin, process.stdout):
            assert pipe is not None
            pipe.close()
