"""Command line, fault proxy and virtual bench in one process on one virtual clock.

The host is the command line as it is (`benchtool sweep tcp:...`), only its socket is one of ours:
every wait of it lets the bench and the proxy run on by 2 ms. A run takes about a second of
processor time on any machine and gives the same answer each time.

    late = Fault("delay", phase="ramping", way="device", only=",pwm,", delay_s=0.9)
    outcome = sweep(tmp_path, plan("1.36"), [late])
    assert late.hit and outcome.code == 3
"""

from __future__ import annotations

import csv
import io
import json
import os
import re
from collections.abc import Callable, Sequence
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

from benchtool.bench.drivers import Address
from benchtool.bench.serial.bench import SerialBench
from benchtool.commands.app import main
from benchtool.core.errors import LinkLost
from benchtool.core.rig_file import rig_named
from benchtool.physics.model_file import load_model
from benchtool.virtual.devices import standard_truth, virtual_server
from benchtool.virtual.faults import fault_from
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.protocol import DeviceLink
from tests.faults.proxy import TURNING_US, Fault, Proxy, Seen

STEP_S = 0.002
WATCHED_S = 1.5
"""The device is watched for so long after the host has ended."""

LONGEST_S = 600.0
"""Virtual time after which a run hangs."""

ADDRESS = "tcp:127.0.0.1:1"


class Hangs(BaseException):
    """The run did not end in LONGEST_S of virtual time."""


class World:
    """A virtual bench, the proxy, and their time; it is also the link that the bench listens on.

    Attributes:
        device: speaks the protocol.
        pulses: time and highest pulse that the device itself put out, at each change.
        left_s: when the host closed the link last.
        hooks: called at every step.
    """

    address = "loop"

    def __init__(
        self,
        faults: list[Fault],
        speed: float = 5.0,
        rig_name: str = "pquad_single",
        hooks: Sequence[Callable[[World], None]] = (),
        device_faults: Sequence[str] = (),
    ) -> None:
        rig = rig_named(rig_name)
        self.now_s = 1000.0
        self.proxy = Proxy(faults, self.clock)
        self.pulses: list[tuple[float, float]] = []
        self.left_s: float | None = None
        self.hooks = hooks
        self._deadline_s = self.now_s + LONGEST_S
        truth = load_model(standard_truth(rig), rig).model
        self._server = virtual_server(
            rig,
            truth,
            self,
            speed=speed,
            faults=[fault_from(text) for text in device_faults],
            speak=self._keep,
            clock=self.clock,
        )

    def _keep(self, firmware: Firmware) -> DeviceLink:
        self.device = DeviceLink(firmware)
        return self.device

    def clock(self) -> float:
        return self.now_s

    def read(self) -> bytes:
        return self.proxy.far.outgoing.take()

    def write(self, data: bytes) -> int:
        self.proxy.far.incoming.waiting += data
        return len(data)

    def unplug(self) -> None:
        self.proxy.near.is_cut = True

    def replug(self) -> None:
        raise NotImplementedError

    close = replug

    def step(self) -> None:
        self.now_s += STEP_S
        if self.now_s > self._deadline_s:
            raise Hangs
        self.proxy.step()
        self._server.step()
        self.proxy.step()
        highest_us = float(max(self.device.firmware.pwm_us))
        if not self.pulses or highest_us != self.pulses[-1][1]:
            self.pulses.append((self.now_s, highest_us))
        for hook in self.hooks:
            hook(self)

    def wait(self, seconds: float) -> None:
        """Let time pass while the host does nothing."""
        until_s = self.now_s + seconds
        while self.now_s < until_s:
            self.step()


class LoopTransport:
    """The host's socket."""

    baud = None

    def __init__(self, world: World) -> None:
        self._world = world
        self._near = world.proxy.near

    def open(self) -> None:
        self._world.proxy.connect()

    def _raise_if_cut(self) -> None:
        if self._near.is_cut:
            raise LinkLost(f"{ADDRESS} closed the connection; look at its power and cable")

    def read(self, timeout_s: float) -> bytes:
        until_s = self._world.now_s + max(timeout_s, STEP_S)
        while self._world.now_s < until_s:
            self._world.step()
            if data := self._near.outgoing.take():
                return data
            self._raise_if_cut()
        return b""

    def write(self, data: bytes) -> None:
        self._raise_if_cut()
        self._near.incoming.waiting += data

    def close(self) -> None:
        self._world.step()
        self._world.left_s = self._world.now_s


@dataclass
class Outcome:
    """What one command brought.

    Attributes:
        pulses: time and highest pulse that the device itself put out, at each change.
    """

    code: int  # exit code
    said: str  # standard output and error
    seen: Seen  # what host and device said, before any fault
    pulses: list[tuple[float, float]]
    left_s: float  # when the host gave the link back
    folder: Path  # where the command ran; `run` in it is the run's folder

    @property
    def last_line(self) -> str:
        """The last line, without the program's name."""
        lines = self.said.strip().splitlines()
        return lines[-1].removeprefix("benchtool: ") if lines else ""

    @property
    def metadata(self) -> dict[str, Any]:
        """The run's metadata."""
        loaded: dict[str, Any] = json.loads((self.folder / "run/metadata.json").read_text())
        return loaded

    def rows(self, name: str = "samples.csv") -> list[dict[str, str]]:
        """Return the rows of a table of the run, none where there is no table."""
        path = self.folder / "run" / name
        return list(csv.DictReader(path.read_text().splitlines())) if path.exists() else []

    def points(self) -> list[dict[str, str]]:
        """Return the points of the run without its tares."""
        return [row for row in self.rows("points.csv") if row["kind"] != "tare"]

    def pulse_at(self, at_s: float) -> float:
        """Return the device's own pulse at a moment."""
        return ([us for s, us in self.pulses if s <= at_s] or [0.0])[-1]

    def orders_to_turn_after(self, at_s: float) -> list[tuple[float, float]]:
        """Return each pulse above idle that the device took up after a moment."""
        return [(s, us) for s, us in self.pulses if s > at_s and us >= TURNING_US]

    def standing_at(self) -> float | None:
        """Return when the device's own pulse came to rest for good, None where it still turns."""
        last_s, last_us = self.pulses[-1]
        return last_s if last_us < TURNING_US else None


def plan(distances: str = "1.36", sample_s: float = 2.0, pulses: str = "1500.0") -> str:
    """Return a plan without references or anchors."""
    return (
        f'name = "r"\nrepeats = 1\nsample_s = {sample_s}\n[plate]\ndistances_m = [{distances}]\n'
        f"[throttle]\npwm_us = [{pulses}]\n"
        f'[order]\nkind = "as_given"\nreferences = false\nanchor_every = 0\n'
    )


def sweep(
    folder: Path,
    plan_text: str,
    faults: list[Fault],
    *more: str,
    hooks: Sequence[Callable[[World], None]] = (),
) -> Outcome:
    """Sweep a plan into folder/run."""
    (folder / "plan.toml").write_text(plan_text)
    words = ["--rig", "pquad_single", "--plan", "plan.toml", "--yes", "--out", "run", *more]
    return command(["sweep", ADDRESS, *words], folder, World(faults, hooks=hooks))


def command(words: list[str], folder: Path, world: World) -> Outcome:
    """Run `benchtool WORDS` in a folder; its address ADDRESS leads into the world."""

    def open_loop(parsed: Address) -> SerialBench:
        return SerialBench(LoopTransport(world), parsed.text, world.clock)

    heard, code = io.StringIO(), 0
    state = {"BENCHTOOL_STATE": str(folder / ".state"), "BENCHTOOL_DEBUG": ""}
    with (
        mock.patch("benchtool.bench.serial.bench.open_tcp", open_loop),
        mock.patch.dict(os.environ, state),
        mock.patch("sys.stdin", io.StringIO()),
        chdir(folder),
        redirect_stdout(heard),
        redirect_stderr(heard),
    ):
        try:
            main(words)
        except SystemExit as ended:
            code = ended.code if isinstance(ended.code, int) else 1
    left_s = world.now_s if world.left_s is None else world.left_s
    world.wait(WATCHED_S)
    return Outcome(
        code,
        re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", heard.getvalue()),
        world.proxy.seen,
        world.pulses,
        left_s,
        folder,
    )
