"""The firmware in simavr, with the physics of a rig wired to its pins.

`peer.c` runs the chip and the parts around it; here they are built, and every 5 ms of simulated
time the virtual bench's physics takes the pulses that were measured at the ESC pins and says what
load cell, speed sensors and battery show. Time passes only while a host waits (`AvrBench`), or at
the wall's pace, for hosts that are processes of their own (`PacedAvrBench`).
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

from benchtool.bench.serial.sketch import MCU, sketch_files
from benchtool.core.rig import Rig
from benchtool.physics.model_file import load_model
from benchtool.simulate.plate_bench import PlateBench
from benchtool.virtual.devices import virtual_plant

INSTALL = "apt-get install gcc-avr avr-libc simavr libsimavr-dev libelf-dev"
BAUD = 500_000
STEP_S = 0.005
HEARD_BYTES = 1500  # most that is sent in one line of the peer
DIVIDER = 6.8 / 106.8  # of the battery's voltage, at the ADC (pins.h)


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
    for name, text in sketch_files("uno", rig, "bench-avr", "bench").items():
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
    """Hold what was seen at the pins, in simulated time: us since power-on."""

    time_us: float
    pulses_us: tuple[float, float]  # (2,) last pulse of each ESC, 0 when there is none any more
    heard_us: float  # when the last byte reached the chip
    drive_us: float  # when the last pulse above stop ended
    edge_us: float  # when the last pulse of any length ended
    faults: int  # readings that a real HX711 would have garbled
    untouched: int  # bytes of memory that neither variables nor stack ever used
    stood_us: float  # how long the simulated clock stood still for a machine that was too slow


class AvrBench:
    """Run the firmware with a bench around it; its time passes while somebody waits for it.

    It is also the transport of a host in this process, for which nothing is ever late.

    Attributes:
        plant: the physics.
        battery: whether the pack is connected.
        hung_N: weight of what hangs on the load cell besides.
        state: what was seen at the pins last.
    """

    address = "serial:lockstep"
    baud = BAUD
    mode: tuple[str, ...] = ("lockstep",)

    def __init__(self, peer: Path, firmware: Path, rig: Rig) -> None:
        self.plant = physics(rig)
        self.battery = True
        self.hung_N = 0.0
        self.state = State(0.0, (0.0, 0.0), 0.0, 0.0, 0.0, 0, 0, 0.0)
        self._order = "-"
        self._to_chip = self._from_chip = b""
        self._rotors = rig.n_rotors
        self._names = [channel.name for channel in self.plant.channels]
        self._seen = {"voltage_V": rig.propulsion.voltage_nominal_V}
        self._process = subprocess.Popen(
            [peer, firmware, MCU, *self.mode],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.shut_down()

    def shut_down(self) -> None:
        """Switch it off."""
        self._process.kill()
        self._process.communicate()

    def clock(self) -> float:
        """Return the simulated time, s."""
        return 1e-6 * self.state.time_us

    def open(self) -> None:
        """Have the chip start, which hears nothing before, and forget what it said."""
        self.wait(lambda state: state.edge_us > 0.0)
        self._from_chip = b""

    def close(self) -> None: ...

    def write(self, data: bytes) -> None:
        self._to_chip += data

    def read(self, timeout_s: float) -> bytes:
        end_s = self.clock() + max(timeout_s, STEP_S)
        while self.clock() < end_s - 1e-9:
            self.step()
            if self._from_chip:
                break
        data, self._from_chip = self._from_chip, b""
        return data

    def wait(self, until: Callable[[State], bool], timeout_s: float = 5.0) -> State:
        """Return the first state that is wanted.

        Args:
            timeout_s: simulated time.
        """
        end_s = self.clock() + timeout_s
        while not until(self.state):
            assert self.clock() < end_s, self.state
            self.step()
        return self.state

    def hang(self) -> None:
        """Let the program hang with interrupts off."""
        self._order = "hang"

    def unplug_cell(self) -> None:
        """Pull the load cell's amplifier off."""
        self._order = "unplug"

    def place_plate(self, z_m: float) -> None:
        """Put the plate somewhere at once, as a hand does between two looks."""
        self.plant.command_plate(z_m)
        rate_Hz = self.plant.rate_Hz
        while self.plant.plate_moving:
            self.plant.advance(round(rate_Hz))

    def step(self) -> bool:
        """Exchange one line with the peer; False where it has ended."""
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None
        assert stdout is not None
        words = stdout.readline().split()
        if not words:
            return False
        time_us, one_us, two_us, heard_us, drive_us, edge_us, faults, untouched, stood_us = map(
            float, words[:9]
        )
        pulses = (one_us, two_us)
        self._from_chip += bytes.fromhex("".join(words[9:]))
        self.state = State(
            time_us, pulses, heard_us, drive_us, edge_us, int(faults), int(untouched), stood_us
        )
        to_chip, self._to_chip = self._to_chip[:HEARD_BYTES], self._to_chip[HEARD_BYTES:]
        order, self._order = self._order, "-"
        try:
            stdin.write(f"{self._advance(pulses)} {order} {to_chip.hex()}\n")
            stdin.flush()
        except BrokenPipeError:
            return False
        return True

    def _advance(self, pulses: tuple[float, float]) -> str:
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


class PacedAvrBench(AvrBench):
    """Run it at the wall's pace on a pseudo-terminal, for hosts in processes of their own.

    Attributes:
        address: what a host writes to reach it.
    """

    mode = ()

    def __init__(self, peer: Path, firmware: Path, rig: Rig) -> None:
        super().__init__(peer, firmware, rig)
        assert self._process.stdout is not None
        self.address = f"serial:{self._process.stdout.readline().strip()}?baud={BAUD}"
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def shut_down(self) -> None:
        self._process.kill()
        self._thread.join()
        self._process.communicate()

    def wait(self, until: Callable[[State], bool], timeout_s: float = 5.0) -> State:
        end_s = self.clock() + timeout_s
        while not until(state := self.state):
            assert self.clock() < end_s, state
            assert self._thread.is_alive()
            time.sleep(0.002)
        return state

    def place_plate(self, z_m: float) -> None:
        with self._lock:
            super().place_plate(z_m)

    def _run(self) -> None:
        while self.step():
            pass

    def _advance(self, pulses: tuple[float, float]) -> str:
        with self._lock:
            return super()._advance(pulses)


def physics(rig: Rig) -> PlateBench:
    """Return the virtual bench of a rig, in steps of the peer."""
    return virtual_plant(rig, load_model("single", rig).model, seed=0, rate_Hz=1.0 / STEP_S)
