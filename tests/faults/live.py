"""A cell in real time: the host is a process of its own, proxy and device are outside of it."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

from tests.faults.loop import Outcome, World

NAP_S = 0.001
WATCHED_S = 0.6
"""The device is watched for so long after the host has ended."""


def sweep_live(world: World, folder: Path, plan_text: str) -> Outcome:
    """Sweep a plan into folder/run by a process; the world lives on this machine's clock."""
    (folder / "plan.toml").write_text(plan_text)
    words = ["--rig", "pquad_single", "--plan", "plan.toml", "--yes", "--out", "run"]
    state = {"BENCHTOOL_STATE": str(folder / ".state"), "PYTHONUNBUFFERED": "1"}
    with (folder / "said").open("wb") as said:
        host = subprocess.Popen(
            [sys.executable, "-m", "benchtool", "sweep", world.address, *words, *world.more],
            cwd=folder,
            env={**os.environ, **state},
            stdin=subprocess.DEVNULL,
            stdout=said,
            stderr=subprocess.STDOUT,
        )
        world.proxy.connect()
        try:
            while host.poll() is None:
                pass_time(world)
        finally:
            host.kill()
            host.wait()
    left_s = world.now_s
    while world.now_s < left_s + WATCHED_S:
        pass_time(world)
    text = (folder / "said").read_text("utf-8")
    return Outcome(host.returncode, text, world.proxy.seen, world, world.pulses, left_s, folder)


def pass_time(world: World) -> None:
    """Let the world catch up with this machine."""
    time.sleep(NAP_S)
    world.step(time.monotonic() - world.now_s)
