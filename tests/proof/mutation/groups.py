"""What is broken and who must notice: modules with the tests that judge them, and named mutants."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Group:
    """Name modules and the tests that judge them, those that notice most first.

    Attributes:
        sampled: modules of which any line may be broken.
        beside: modules of which only named mutants are judged.
    """

    sampled: tuple[str, ...]
    tests: tuple[str, ...]
    beside: tuple[str, ...] = ()


BENCH, UNIT_BENCH = "benchtool/bench", "tests/unit/bench"
STORED = (
    "tests/unit/data/test_run.py",
    "tests/unit/data/test_closing.py",
    "tests/unit/data/test_links.py",
    "tests/unit/data/test_syncs.py",
)

GROUPS = {
    "guard": Group(
        (f"{BENCH}/guard.py", f"{BENCH}/motor_state.py", f"{BENCH}/stop_requests.py"),
        (
            f"{UNIT_BENCH}/test_guard.py",
            f"{UNIT_BENCH}/test_guard_talks.py",
            f"{UNIT_BENCH}/test_stop_signals.py",
            f"{UNIT_BENCH}/test_late_readings.py",
            f"{UNIT_BENCH}/test_standstill.py",
        ),
        beside=(f"{BENCH}/clocks.py",),
    ),
    "limits": Group(
        (f"{BENCH}/limit_check.py", f"{BENCH}/plate_check.py"),
        (
            f"{UNIT_BENCH}/test_plate_check.py",
            f"{UNIT_BENCH}/test_limit_check.py",
            f"{UNIT_BENCH}/test_guard_talks.py",
        ),
    ),
    "append": Group(("benchtool/data/run/append.py", "benchtool/data/atomic.py"), STORED),
    "resume": Group(
        ("benchtool/acquire/resume.py",),
        ("tests/unit/acquire/test_resume.py",),
    ),
    "close": Group(("benchtool/data/run/run.py",), STORED),
    "link": Group(
        (f"{BENCH}/serial/frames.py", f"{BENCH}/mavlink/frames.py"),
        (
            f"{UNIT_BENCH}/test_link.py",
            f"{UNIT_BENCH}/test_sample_order.py",
            f"{UNIT_BENCH}/test_mavlink_frames.py",
            "tests/wire/test_mavlink_conversations.py",
            "tests/wire/test_conversations.py",
            "tests/wire/test_mavlink_bench.py",
        ),
        beside=(f"{BENCH}/serial/command_channel.py",),
    ),
    "images": Group(
        ("benchtool/physics/images.py",),
        (
            "tests/unit/physics/test_images.py",
            "tests/unit/physics/test_paper_tables.py",
            "tests/unit/physics/test_tilt.py",
        ),
    ),
    "verdict": Group(
        ("benchtool/explain/engine/posterior.py", "benchtool/explain/result.py"),
        (
            "tests/unit/explain/test_verdict_words.py",
            "tests/unit/explain/test_posterior.py",
        ),
    ),
}


@dataclass(frozen=True)
class Named:
    """Describe a mutant by hand: one piece of a module's text, found once, and what replaces it."""

    name: str
    module: str
    before: str
    after: str

    @property
    def judges(self) -> tuple[str, ...]:
        """Give the tests of the group that has its module."""
        (group,) = (one for one in GROUPS.values() if self.module in one.sampled + one.beside)
        return group.tests

    def applied(self, source: str) -> str:
        """Return the module's source with the change."""
        assert source.count(self.before) == 1, f"{self.name}: {self.before!r} in {self.module}"
        return source.replace(self.before, self.after)


NAMED = tuple(
    Named(name, module, before, after)
    for module, mutants in tomllib.loads(
        Path(__file__).with_name("named.toml").read_text("utf-8")
    ).items()
    for name, (before, after) in mutants.items()
)
