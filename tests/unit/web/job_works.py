"""Works for the jobs of `test_job`: what a spawned process imports."""

from __future__ import annotations

import os
import time

from benchtool.errors import UnknownChoice
from benchtool.web.job import Tell


def add(tell: Tell, a: int, b: int) -> int:
    tell("adding", 0.2)
    tell("adding", 0.5)
    tell("done", 1.0)
    return a + b


def refuse(tell: Tell) -> int:
    raise UnknownChoice("rig", "quat", ["quad"])


def stumble(tell: Tell) -> int:
    return 1 // 0


def fall(tell: Tell) -> int:
    os._exit(9)


def linger(tell: Tell) -> int:
    tell("lingering", 0.1)
    time.sleep(60.0)
    return 0


def name_own_process(tell: Tell) -> tuple[int, int]:
    return os.getpid(), os.nice(0)
