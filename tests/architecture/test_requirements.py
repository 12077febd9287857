"""The locked requirements: hashed, without an address, in step with pyproject.toml."""

from __future__ import annotations

import re
import tomllib

import pytest
from packaging.requirements import Requirement

from tests.architecture.tracked import ROOT

LOCKS = ("run.txt", "test.txt", "docs.txt")
TABLES = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
OPTIONAL = TABLES["project"]["optional-dependencies"]
NEEDS = TABLES["project"]["dependencies"] + TABLES["dependency-groups"]["build"] + OPTIONAL["fast"]
MACHINES = [
    {"python_version": f"3.{minor}", "python_full_version": f"3.{minor}.5", **platform}
    for minor in (11, 12, 13)
    for platform in (
        {"sys_platform": "linux", "platform_machine": "x86_64", "os_name": "posix"},
        {"sys_platform": "linux", "platform_machine": "aarch64", "os_name": "posix"},
        {"sys_platform": "darwin", "platform_machine": "arm64", "os_name": "posix"},
        {"sys_platform": "darwin", "platform_machine": "x86_64", "os_name": "posix"},
        {"sys_platform": "win32", "platform_machine": "AMD64", "os_name": "nt"},
    )
]


def entries(lock: str) -> list[str]:
    """Split a lock into one text per requirement, hashes included."""
    text = (ROOT / "requirements" / lock).read_text(encoding="utf-8")
    return re.findall(r"^[a-z0-9].*(?:\n .*)*", text, re.MULTILINE)


def requirements(lock: str) -> list[Requirement]:
    """Parse what a lock pins."""
    return [Requirement(re.split(r" \\\n", entry)[0]) for entry in entries(lock)]


def chosen(found: list[Requirement], machine: dict[str, str]) -> dict[str, str]:
    """Give name and version of what is installed on one machine; twice the same name fails."""
    pairs = [
        (r.name, str(r.specifier)) for r in found if not r.marker or r.marker.evaluate(machine)
    ]
    assert len(dict(pairs)) == len(pairs)
    return dict(pairs)


@pytest.mark.parametrize("lock", LOCKS)
def test_every_requirement_is_pinned_and_hashed(lock):
    found = entries(lock)
    assert len(found) > 30
    assert [e for e in found if not re.match(r"[\w.-]+==\S+", e) or "--hash=sha256:" not in e] == []


@pytest.mark.parametrize(
    ("lock", "lines"),
    [
        (LOCKS[0], NEEDS),
        (LOCKS[1], NEEDS + OPTIONAL["test"]),
        (LOCKS[2], TABLES["dependency-groups"]["docs"]),
    ],
)
def test_a_lock_holds_what_the_project_asks_for(lock, lines):
    asked = [Requirement(line) for line in lines if not line.startswith("benchtool")]
    for machine in MACHINES:
        pinned = chosen(requirements(lock), machine)
        for need in asked:
            if need.marker is None or need.marker.evaluate(machine):
                assert need.specifier.contains(pinned[need.name].removeprefix("=="))


def test_the_locks_agree():
    for machine in MACHINES:
        tool, tested, site = (chosen(requirements(lock), machine) for lock in LOCKS)
        assert tool.items() <= tested.items()
        assert {name: site[name] for name in site.keys() & tested.keys()}.items() <= tested.items()
