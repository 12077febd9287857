"""How tests are run: nothing is tried again, too busy is a skip, and skips are counted."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.architecture.tracked import ROOT
from tests.skips import summary

PLUGIN = """
from tests.busy import Probe, TooBusy

class Late(Probe):
    def __init__(self):
        pass

    def worst_s(self, begin_s, end_s):
        return {late_s}

def pytest_configure(config):
    config.addinivalue_line("markers", "real_time: needs real time")
    config.pluginmanager.register(TooBusy(Late()))
"""
CASES = """
import pytest

@pytest.fixture
def broken():
    assert False, "in its set-up"

@pytest.mark.real_time(deadline_s=0.1)
def test_fails():
    assert 1 == 2, "in real time"

@pytest.mark.real_time(deadline_s=0.1)
def test_fails_before_it_begins(broken): ...

@pytest.mark.real_time(deadline_s=0.1)
def test_passes(): ...

def test_needs_no_real_time():
    assert False, "for good"
"""


def run(folder: Path, late_s: float) -> tuple[str, Path]:
    """Run CASES on a machine that is so late; return what pytest said and its JUnit file."""
    (folder / "conftest.py").write_text(PLUGIN.format(late_s=late_s), "utf-8")
    (folder / "test_cases.py").write_text(CASES, "utf-8")
    junit = folder / "tests.xml"
    words = ["-q", "-rs", "--tb=no", "-p", "no:cacheprovider", f"--junitxml={junit}", str(folder)]
    command = [sys.executable, "-m", "pytest", *words, f"--rootdir={folder}", "-c", "/dev/null"]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return ended.stdout, junit


def test_a_failure_on_a_machine_that_was_late_is_a_skip_with_its_numbers(tmp_path):
    said, junit = run(tmp_path, late_s=0.25)
    assert "1 failed, 1 passed, 2 skipped" in said
    assert "a sleep ended 0.250 s late, this test needs 0.1 s; it failed with" in said
    assert "in real time" in said
    assert "in its set-up" in said
    text, too_many = summary([junit])
    assert too_many
    assert text.splitlines()[-1] == "2 of 4 tests skipped: 50.0%, limit 2%"
    assert text.count("too busy: a sleep ended") == 2


def test_a_failure_in_time_stands(tmp_path):
    said, junit = run(tmp_path, late_s=0.09)
    assert "2 failed, 1 passed, 1 error" in said
    assert summary([junit]) == ("0 of 4 tests skipped: 0.0%, limit 2%", False)
