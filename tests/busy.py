"""Tests that need real time say "too busy" where this machine was too late for them.

A process of its own sleeps for 5 ms again and again and notes each time when it woke up late. A
test marked `real_time(deadline_s)` that fails while a sleep ended later than its deadline counts
as skipped, with both numbers and its failure as the reason. Every other failure stands.

The process is apart from the tests, so that what they compute themselves is no excuse for them.
Stop, dead-man and watchdog logic is tested on virtual clocks (`tests/faults`, `tests/unit`).
"""

from __future__ import annotations

import atexit
import subprocess
import sys
import time
from collections.abc import Generator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

SLEEP = """
import sys, time
from pathlib import Path
notes = Path(sys.argv[1]).open("w", buffering=1)
print("started", flush=True)
while not notes.closed:
    due_s = time.monotonic() + 0.005
    time.sleep(0.005)
    woken_s = time.monotonic()
    if woken_s - due_s > 0.010:
        print(due_s, woken_s, file=notes)
"""
"""`time.monotonic` is one clock for all processes of a machine."""

MARGIN_S = 1.0  # what stood still before a test began may still be felt in it


class Probe:
    """Measure how late this machine wakes a process up, from now on."""

    def __init__(self) -> None:
        self._folder = TemporaryDirectory()
        self._notes = Path(self._folder.name) / "late.txt"
        self._process = subprocess.Popen(
            [sys.executable, "-I", "-S", "-c", SLEEP, self._notes], stdout=subprocess.PIPE
        )
        assert self._process.stdout is not None
        self._process.stdout.readline()
        atexit.register(self.close)

    def close(self) -> None:
        """End the process."""
        atexit.unregister(self.close)
        self._process.kill()
        self._process.communicate()
        self._folder.cleanup()

    def worst_s(self, begin_s: float, end_s: float) -> float:
        """Return the worst lateness of a sleep that overlapped a span of `time.monotonic`, s."""
        noted = [line.split() for line in self._notes.read_text("utf-8").splitlines(True)]
        spans = [(float(words[0]), float(words[1])) for words in noted if len(words) == 2]
        late = [woken - due for due, woken in spans if due <= end_s and woken >= begin_s]
        return max(late, default=0.0)


class TooBusy:
    """Plugin: skip what failed in real time on a machine that was later than the test's deadline.

    Args:
        probe: measures lateness; one is started with the first test that needs it.
    """

    def __init__(self, probe: Probe | None = None) -> None:
        self._probe = probe
        self._begun_s = 0.0

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> None:
        """Have the probe run before the test does."""
        if item.get_closest_marker("real_time"):
            self._probe = self._probe or Probe()
        self._begun_s = time.monotonic() - MARGIN_S

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Item, call: pytest.CallInfo[None]
    ) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        """Turn a failure into a skip where the machine was too late."""
        report = yield
        marker = item.get_closest_marker("real_time")
        if marker is None or self._probe is None or not report.failed or call.excinfo is None:
            return report
        deadline_s = float(marker.kwargs["deadline_s"])
        late_s = self._probe.worst_s(self._begun_s, time.monotonic())
        if late_s > deadline_s:
            path, line, _ = item.location
            reason = (
                f"too busy: a sleep ended {late_s:.3f} s late, this test needs {deadline_s:g} s; "
                f"it failed with {call.excinfo.exconly(tryshort=True).splitlines()[0]}"
            )
            report.outcome = "skipped"
            report.longrepr = (str(item.config.rootpath / path), (line or 0) + 1, reason)
        return report
