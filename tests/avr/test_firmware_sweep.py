"""`benchtool` on the firmware, as a user runs it: check, sweep, and a host that is killed."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from benchtool.data.run.append import read_events
from benchtool.data.run.read import read_points
from tests.avr.avr_bench import PacedAvrBench
from tests.system.served import COMMAND, environment_of

SMALL = ["--rig", "pquad_single", "--stage", "hand", "--repeats", "1", "--z-over-r", "0.6,2"]
ONE = [*SMALL, "--pwm", "1550", "--sample-s", "1", "--anchor-every", "0", "--yes"]


@pytest.fixture
def environment(tmp_path):
    return environment_of(tmp_path)


@contextmanager
def running(
    words: list[str], environment: dict[str, str], errors: Path
) -> Iterator[subprocess.Popen[str]]:
    """Run benchtool with its errors in a file; kill what is left of it at the end."""
    with (
        errors.open("w") as file,
        subprocess.Popen(
            [*COMMAND, *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=file,
            text=True,
            env=environment,
        ) as process,
    ):
        try:
            yield process
        finally:
            process.kill()


def answer_as_asked(
    process: subprocess.Popen[str], question: str, answer: Callable[[float], str]
) -> str:
    """Answer each question, in which a number is asked for; return all that was said."""
    assert process.stdout is not None
    assert process.stdin is not None
    said = unanswered = ""
    while letter := process.stdout.read(1):
        said += letter
        unanswered += letter
        if found := re.search(question, unanswered):
            process.stdin.write(f"{answer(float(found[1]))}\n")
            process.stdin.flush()
            unanswered = ""
    return said


def move_when_asked(process: subprocess.Popen[str], paced: PacedAvrBench) -> str:
    """Be the operator: put the plate where the sweep wants it and type that."""

    def move(z_mm: float) -> str:
        paced.place_plate(1e-3 * z_mm)
        return f"{z_mm}"

    return answer_as_asked(process, r"Move the plate to ([\d.]+) mm.* in mm: $", move)


@pytest.mark.real_time(deadline_s=0.1)
def test_check_and_sweep_by_hand(paced, environment, tmp_path):
    errors, out = tmp_path / "errors.txt", tmp_path / "run"
    check = ["bench", "check", paced.address, "--rig", "pquad_single", "--yes"]
    with running(check, environment, errors) as process:
        told, _ = process.communicate(timeout=60)
    assert process.returncode == 0, told + errors.read_text()
    with running(["sweep", paced.address, *ONE, "--out", str(out)], environment, errors) as process:
        told = move_when_asked(process, paced)
        code = process.wait(10)
    assert code == 0, told + errors.read_text()
    points = read_points(out)
    assert points.simulated
    near, far = (
        float(points.column("thrust_N")[np.isclose(points.column("plate_z_m"), z_m)][0])
        for z_m in (0.072, 0.24)
    )
    # Eq. (2) at z/R of 0.6 and 2: the rotor pushes against the near plate.
    assert near > 1.1 * far > 1.0
    events = read_events(out / "events.jsonl")
    assert not [event for event in events if "dropped" in f"{event}"]
    state = paced.state
    print(f"simulated {1e-6 * state.time_us:.0f} s, stood still for {1e-6 * state.stood_us:.1f} s")
    assert state.faults == 0
    assert state.pulses_us[0] == pytest.approx(1000.0, abs=0.5)
