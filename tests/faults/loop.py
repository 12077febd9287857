"""Command line, fault proxy and virtual bench in one process on one virtual clock.

The host is the command line as it is (`benchtool sweep tcp:...`), only its socket is one of ours:
every wait of it lets the bench and the proxy run on by 4 ms. A run takes about a second of
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
from collections.abc import Callable, Iterator, Sequence
from contextlib import (
    AbstractContextManager,
    chdir,
    contextmanager,
    redirect_stderr,
    redirect_stdout,
)
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

from benchtool.commands.app import main
from benchtool.core.rig_file import load_rig_by_name
from benchtool.physics.model_file import load_model
from benchtool.virtual.devices import ServerOptions, standard_truth, virtual_server
from benchtool.virtual.faults import parse_fault
from benchtool.virtual.firmware import Firmware, TickRows
from benchtool.virtual.links import PtyLink
from benchtool.virtual.server import ServedDevice
from tests.doubles.grbl import CarriedPlate, VirtualGrbl
from tests.faults.dialects import TURNING_US, Seen, StageLines
from tests.faults.links import (
    ADDRESS,
    LINKS,
    STEP_S,
    Far,
    KernelTransport,
    MemoryTransport,
    Port,
    on_the_clock,
    stage_words,
)
from tests.faults.proxy import Fault, Proxy

WATCHED_S, WATCHED_STEP_S = 1.5, 0.02  # the device is watched for so long after the host has ended
LONGEST_S = 600.0  # virtual time after which a run hangs


class Hangs(BaseException):
    """The run did not end in LONGEST_S of virtual time."""


class World:
    """A virtual bench, the proxy before it, and their time.

    Attributes:
        device: speaks the protocol.
        pulses: time and highest pulse that the device itself put out, at each change.
        rows: values that the device itself measured, by its time in us.
        left_s: when the host closed the link last.
        hooks: called at every step.
        proxies: the bench's, and that of a stage.

    Args:
        link: one of `LINKS`; the proxy stands between the bench and its host, or the stage and its.
    """

    def __init__(
        self,
        faults: list[Fault],
        speed: float = 5.0,
        rig_name: str = "pquad_single",
        hooks: Sequence[Callable[[World], None]] = (),
        device_faults: Sequence[str] = (),
        link: str = "memory",
        now_s: float = 1000.0,
        seed: int = 0,
    ) -> None:
        rig = load_rig_by_name(rig_name)
        how = LINKS[link]
        self.now_s = now_s
        self.proxy = Proxy([] if how.has_stage else faults, self.clock, how.dialect())
        self.pulses: list[tuple[float, float]] = []
        self.rows: dict[int, list[float]] = {}
        self.left_s: float | None = None
        self.hooks = hooks
        self.address, self.more = ADDRESS, []
        self.ports: list[Port] = []
        self.proxies = [self.proxy]
        self._deadline_s = self.now_s + LONGEST_S
        if how.port is not None:
            self.ports.append(Port(self.proxy, how.port()))
            self.address = how.address(self.ports[0].link)
        if how.has_stage:
            self.proxies.append(Proxy(faults, self.clock, StageLines(self.proxy.seen)))
            self.ports.append(Port(self.proxies[1], PtyLink()))
            self.more = stage_words(self.ports[1].link, rig)

        def keep(firmware: Firmware) -> ServedDevice:
            self.device = how.protocol(firmware)
            self.channels = [channel.name for channel in firmware.hello.channels]
            self._note_rows(firmware)
            if how.has_stage:
                carried = CarriedPlate(self.device, firmware, Far(self.proxies[1]), rig.plate)
                self.proxies[1].happen = partial(happen_to, carried.stage)
                return carried
            return self.device

        truth = load_model(standard_truth(rig), rig).model
        options = ServerOptions(
            seed=seed,
            speed=speed,
            faults=[parse_fault(text) for text in device_faults],
            protocol=keep,
            clock=self.clock,
        )
        self._server = virtual_server(rig, truth, Far(self.proxy), options)

    def _note_rows(self, firmware: Firmware) -> None:
        advance = firmware.advance

        def noted(n: int, now_s: float) -> TickRows:
            rows = advance(n, now_s)
            times_us = rows.device_time_us.tolist()
            self.rows |= zip(times_us, rows.values.tolist(), strict=True)
            return rows

        firmware.advance = noted  # type: ignore[method-assign]

    def clock(self) -> float:
        return self.now_s

    def step(self, step_s: float = STEP_S) -> None:
        self.now_s += step_s
        if self.now_s > self._deadline_s:
            raise Hangs
        self._carry()
        self._server.step()
        self._carry()
        highest_us = float(max(self.device.firmware.pwm_us))
        if not self.pulses or highest_us != self.pulses[-1][1]:
            self.pulses.append((self.now_s, highest_us))
        for hook in self.hooks:
            hook(self)

    def _carry(self) -> None:
        for port in self.ports:
            port.pump()
        for proxy in self.proxies:
            proxy.step()
        for port in self.ports:
            port.pump()

    def wait(self, seconds: float, step_s: float = STEP_S) -> None:
        """Let time pass while the host does nothing."""
        until_s = self.now_s + seconds
        while self.now_s < until_s:
            self.step(step_s)

    def wrapped(self, real: object) -> MemoryTransport | KernelTransport:
        """Put the bench's transport on this clock; without a port it leads to the proxy itself."""
        if not self.ports:
            return MemoryTransport(self, self.proxy)
        return KernelTransport(self, self.proxy, self.ports[0], real)

    def staged(self, real: object) -> KernelTransport:
        """Put the stage's transport on this clock."""
        return KernelTransport(self, self.proxies[1], self.ports[1], real)

    def hosting(self) -> AbstractContextManager[None]:
        """Let every driver of this process lead here and wait on this clock."""
        return on_the_clock(self, self.wrapped, self.staged)

    def close(self) -> None:
        for port in self.ports:
            port.link.close()


def happen_to(stage: VirtualGrbl, what: str) -> None:
    """Let a limit switch close, somebody press reset, or the power fail for a moment."""
    if what == "limit":
        stage.settings[21] = 1
        stage.switch("Z", closed=True)
    elif what == "reset":
        stage.press("R")
        stage.release()
    else:
        stage.restart()


@dataclass
class Outcome:
    """What one command brought.

    Attributes:
        pulses: time and highest pulse that the device itself put out, at each change.
    """

    code: int  # exit code
    said: str  # standard output and error
    seen: Seen  # what host and device said, before any fault
    world: World
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
    return sweep_in(World(faults, hooks=hooks), folder, plan_text, *more)


def sweep_in(world: World, folder: Path, plan_text: str, *more: str) -> Outcome:
    """Sweep a plan in a world into folder/run."""
    (folder / "plan.toml").write_text(plan_text)
    words = ["--rig", "pquad_single", "--plan", "plan.toml", "--yes", "--out", "run", *more]
    return command(["sweep", world.address, *words, *world.more], folder, world)


@contextmanager
def typed_in(folder: Path) -> Iterator[io.StringIO]:
    """Be in a folder with a state of its own and nobody at the keyboard; give what is printed."""
    heard = io.StringIO()
    state = {"BENCHTOOL_STATE": str(folder / ".state"), "BENCHTOOL_DEBUG": ""}
    with (
        mock.patch.dict(os.environ, state),
        mock.patch("sys.stdin", io.StringIO()),
        chdir(folder),
        redirect_stdout(heard),
        redirect_stderr(heard),
    ):
        yield heard


def command(words: list[str], folder: Path, world: World) -> Outcome:
    """Run `benchtool WORDS` in a folder; its address ADDRESS leads into the world."""

    code = 0
    with world.hosting(), typed_in(folder) as heard:
        try:
            main(words)
        except SystemExit as ended:
            code = ended.code if isinstance(ended.code, int) else 1
    left_s = world.now_s if world.left_s is None else world.left_s
    world.wait(WATCHED_S, WATCHED_STEP_S)
    return Outcome(
        code,
        re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", heard.getvalue()),
        world.proxy.seen,
        world,
        world.pulses,
        left_s,
        folder,
    )
