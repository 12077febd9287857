"""A long count ends at a signal, is resumed where it was, and has its file for itself."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.faults.matrix import CELLS
from tests.long_count import ROOT, LongCount


@pytest.mark.skipif(os.name != "posix", reason="Windows has no signals for one process")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_signal_ends_the_program_and_no_cell(tmp_path: Path, name: str) -> None:
    path = tmp_path / "cells.jsonl"
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.faults.matrix", str(path)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    while not path.exists() or not path.read_text():
        assert process.poll() is None
        time.sleep(0.02)
    with pytest.raises(SystemExit, match="another process writes"), LongCount(path, 9, "cells"):
        pass
    process.send_signal(getattr(signal, name))
    printed, said = process.communicate(timeout=60)
    stored = path.read_text()
    assert process.returncode == 130
    assert printed == ""
    done = stored.count("\n")
    assert (
        said == f"stopped; {done} of {len(CELLS)} cells done, in {path}; the same command resumes\n"
    )
    assert "stopped by" not in stored


PRESSED = """
import signal, sys
from pathlib import Path
from tests.faults import loop, matrix

def press(world):
    if world.pulses[-1][1] > 1200.0 and not pressed:
        pressed.append(signal.raise_signal(signal.SIGINT))

class World(loop.World):
    def __init__(self, *args, **words):
        super().__init__(*args, **words, hooks=[press])

pressed = []
matrix.run_cell.__globals__["World"] = World
cells = [cell for cell in matrix.CELLS if cell.name == "tcp-sampling-samples_twice"]
matrix.main(Path(sys.argv[1]), cells)
"""


def test_a_sweep_whose_motors_turn_does_not_take_the_signal(tmp_path: Path) -> None:
    path = tmp_path / "cells.jsonl"  # in a process that has not loaded what a sweep needs
    line = [sys.executable, "-c", PRESSED, str(path)]
    ended = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, check=False)
    said = f"stopped; 0 of 1 cells done, in {path}; the same command resumes\n"
    assert (ended.returncode, ended.stderr, ended.stdout) == (130, said, "")
    assert path.read_text() == ""


def test_what_swallows_a_signal_is_not_stored(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "notes.jsonl"
    path.write_text("1\n2\n3 is to")
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(SystemExit) as ended, LongCount(path, 4, "items", every=3) as count:  # noqa: PT012
        assert count.lines == ["1", "2"]
        count.add("3")
        try:
            signal.raise_signal(signal.SIGINT)
        except BaseException:  # noqa: BLE001
            pass
        count.add("4")
    assert ended.value.code == 130
    assert path.read_text() == "1\n2\n3\n"
    assert signal.getsignal(signal.SIGINT) is before
    said = capsys.readouterr().err.splitlines()
    assert said[0] == "3 of 4 items done"
    assert said[1].startswith("stopped; 3 of 4 items done, in ")
