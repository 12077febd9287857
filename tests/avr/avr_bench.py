"""The firmware in simavr, with the physics of a rig wired to its pins.

`peer.c` runs the chip and the parts around it; here they are built, and every 5 ms of simulated
time the virtual bench's physics takes the pulses that were measured at the ESC pins and says what
load cell, speed sensors and battery show.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from benchtool.bench.virtual_device import virtual_plant
from benchtool.core.rig import Rig
from benchtool.library import load_model
from benchtool.library.board import board_named
from benchtool.library.sketch_files import sketch_files
from benchtool.simulate.plate_bench import PlateBench

INSTALL = "apt-get install gcc-avr avr-libc simavr libsimavr-dev libelf-dev"
BOARD = board_named("uno")
BAUD = 500_000
STEP_S = 0.005
DIVIDER = 6.8 / 106.8
"""Of the battery's voltage, at the ADC (pins.h)."""


def missing() -> str:
    """Say why the firmware cannot be tried here; nothing when it can."""
    tools = [name for name in ("avr-gcc", "simavr", "make", "cc") if not shutil.which(name)]
    if sys.platform == "win32" or tools:
        return f"needs {', '.join(tools)}; install with: {INSTALL}"
    words = ["cc", "-E", "-isystem", "/usr/include/simavr", "-"]
    tried = subprocess.run(
        words, input="#include <sim_avr.h>\n", text=True, capture_output=True, check=False
    )
    return "" if tried.returncode == 0 else f"needs simavr's headers; install with: {INSTALL}"


def build(folder: Path, rig: Rig, **settings: object) -> Path:
    """Write the firmware for a rig, change settings as a user would, and compile it."""
    sketch = folder / "bench"
    sketch.mkdir()
    for name, text in sketch_files(BOARD, rig, "bench-avr", "bench").items():
        (sketch / name).write_text(text, encoding="utf-8")
    header = sketch / "settings.h"
    text = header.read_text("utf-8")
    for name, value in {"SIMULATED": 1, **settings}.items():
        text, found = re.subn(rf"(#define {name}) \S+", rf"\1 {value}", text)
        assert found == 1, name
    header.write_text(text, encoding="utf-8")
    subprocess.run(["make", "-s", "-C", sketch], check=True)
    return sketch / "firmware.elf"


def build_peer(folder: Path) -> Path:
    """Compile the parts around the chip."""
    flags = ["-std=gnu11", "-O2", "-Wall", "-Wextra", "-Werror", "-isystem", "/usr/include/simavr"]
    source, program = Path(__file__).with_name("peer.c"), folder / "peer"
    subprocess.run(
        ["cc", *flags, "-o", program, source, "-lsimavr", "-lelf"], check=True, timeout=60
    )
    return program


@dataclass(frozen=True, slots=True)
class State:
    """Hold what was seen at the pins, in simulated time: us since power-on.

    Attributes:
        pulses_us: (2,) last pulse of each ESC, 0 when there is none any more.
        heard_us: when the last byte reached the chip.
        drive_us: when the last pulse above stop ended.
        edge_us: when the last pulse of any length ended.
        faults: readings that a real HX711 would have garbled.
        untouched: bytes of memory that neither variables nor stack ever used.
        stood_us: how long the simulated clock stood still for a machine that was too slow.
    """

    time_us: float
    pulses_us: tuple[float, float]
    heard_us: float
    drive_us: float
    edge_us: float
    faults: int
    untouched: int
    stood_us: float


class AvrBench:
    """Run the firmware with a bench around it until closed.

    Attributes:
        address: what a host writes to reach it.
        plant: the physics.
        battery: whether the pack is connected.
        hung_N: weight of what hangs on the load cell besides.
    """

    def __init__(self, peer: Path, firmware: Path, rig: Rig, truth: str = "single") -> None:
        self.plant = physics(rig, truth)
        self.battery = True
        self.hung_N = 0.0
        self._lock = threading.Lock()
        self._order = ""
        self._rotors = rig.n_rotors
        self._names = [channel.name for channel in self.plant.channels]
        self._seen = {"voltage_V": rig.propulsion.voltage_nominal_V}
        self._process = subprocess.Popen(
            [peer, firmware, BOARD.mcu],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self._process.stdout is not None
        self.port = self._process.stdout.readline().strip()
        self.address = f"serial:{self.port}?baud={BAUD}"
        self.state = State(0.0, (0.0, 0.0), 0.0, 0.0, 0.0, 0, 0, 0.0)
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Switch it off."""
        self._process.terminate()
        self._thread.join()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout, self._process.stderr):
            assert stream is not None
            try:
                stream.close()
            except BrokenPipeError:
                pass

    def hang(self) -> None:
        """Let the program hang with interrupts off."""
        with self._lock:
            self._order = " hang"

    def unplug_cell(self) -> None:
        """Pull the load cell's amplifier off."""
        with self._lock:
            self._order = " unplug"

    def place_plate(self, z_m: float) -> None:
        """Put the plate somewhere at once, as a hand does between two looks."""
        with self._lock:
            self.plant.command_plate(z_m)
            rate_Hz = self.plant.rate_Hz
            while self.plant.plate_moving:
                self.plant.advance(round(rate_Hz))

    def wait(self, until: Callable[[State], bool], timeout_s: float = 5.0) -> State:
        """Return the first state seen that is wanted.

        Args:
            timeout_s: simulated time.
        """
        end_us = self.state.time_us + 1e6 * timeout_s
        while not until(state := self.state):
            assert state.time_us < end_us, state
            assert self._thread.is_alive(), self._said()
            time.sleep(0.002)
        return state

    def _said(self) -> str:
        assert self._process.stderr is not None
        return self._process.stderr.read()

    def _run(self) -> None:
        assert self._process.stdout is not None
        assert self._process.stdin is not None
        for line in self._process.stdout:
            time_us, one_us, two_us, heard, drive, edge, faults, free, stood = line.split()
            pulses = (float(one_us), float(two_us))
            self.state = State(
                float(time_us),
                pulses,
                float(heard),
                float(drive),
                float(edge),
                int(faults),
                int(free),
                float(stood),
            )
            with self._lock:
                answer, self._order = self._step(pulses) + self._order, ""
            try:
                self._process.stdin.write(f"{answer}\n")
                self._process.stdin.flush()
            except BrokenPipeError:
                return

    def _step(self, pulses: tuple[float, float]) -> str:
        self.plant.command_pwm(np.array(pulses[: self._rotors]))
        row = self.plant.advance(1)[0]
        self._seen |= {
            name: float(value)
            for name, value in zip(self._names, row, strict=True)
            if value == value
        }
        rpm = [self._seen.get(f"rpm{i}", 0.0) for i in (1, 2)]
        volt = self._seen["voltage_V"] * DIVIDER if self.battery else 0.0
        counts = round(self._seen.get("thrust_raw", 0.0) + self.hung_N / self.plant.count_N)
        return f"{counts} {rpm[0]:.1f} {rpm[1]:.1f} {1000.0 * volt:.1f}"


def physics(rig: Rig, truth: str = "single") -> PlateBench:
    """Return the virtual bench of a rig, in steps of the peer."""
    return virtual_plant(rig, load_model(truth, rig).model, seed=0, rate_Hz=1.0 / STEP_S)
