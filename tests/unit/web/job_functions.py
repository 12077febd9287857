"""Functions for the jobs of `test_jobs`, importable by a spawned process."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

from benchtool.core.errors import UnknownChoice
from benchtool.tasks import ReportProgress

Function = Callable[[ReportProgress, Path, tuple[str, ...]], int]


def add(report: ReportProgress, out: Path, command: tuple[str, ...], a: int, b: int) -> int:
    assert (out, command) == (Path("out"), ("add",))
    report("adding", 0.2)
    report("adding", 0.5)
    report("done", 1.0)
    return a + b


def refuse(report: ReportProgress, *_: object) -> int:
    raise UnknownChoice("rig", "quat", ["quad"])


def stumble(report: ReportProgress, *_: object) -> int:
    return 1 // 0


def fall(report: ReportProgress, *_: object) -> int:
    os._exit(9)


def linger(report: ReportProgress = lambda stage, share: None, *_: object) -> int:
    report("lingering", 0.1)
    time.sleep(60.0)
    return 0
