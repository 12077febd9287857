"""A long count ends at a signal, is resumed where it was, and has its file for itself."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from functools import partial
from unittest import mock

import pytest

from tests.faults.matrix import CELLS
from tests.long_count import ROOT, LongCount


@pytest.mark.skipif(os.name != "posix", reason="Windows has no signals for one process")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_signal_ends_the_program_and_no_cell(tmp_path, name):
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


@pytest.mark.skipif(os.name != "posix", reason="Windows has no signals for one process")
def test_a_line_is_counted_when_a_signal_comes_while_it_is_stored(tmp_path, capsys):
    path, count = tmp_path / "lines", LongCount(tmp_path / "lines", 2, "lines")
    kill = partial(os.kill, os.getpid(), signal.SIGTERM)
    with pytest.raises(SystemExit), count, mock.patch.object(count._file, "flush", kill):
        count.add("one")
    assert path.read_text() == "one\n"
    assert "stopped; 1 of 2 lines done" in capsys.readouterr().err
