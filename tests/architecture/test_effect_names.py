"""What is known of an effect stands in its own file: no other file names one."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import benchtool
from benchtool.physics.catalogue import EFFECTS

PACKAGE = Path(benchtool.__file__).parent
CASES = ("acquire/check_plan.py",)  # cases and recipes: they are about named effects

OTHER_THINGS = (
    *("virtual/autopilot.py", "report/palette.py"),
    "data/run/append.py",
)
"""A channel of an autopilot, roles of curves and a clock on a wall have an effect's name."""

NAME = re.compile(rf"({'|'.join(EFFECTS)})(\.\w+)?")


def files() -> list[Path]:
    own = ("physics/effects/", *CASES, *OTHER_THINGS)
    return [file for file in sorted(PACKAGE.rglob("*.py")) if not place(file).startswith(own)]


def place(file: Path) -> str:
    return file.relative_to(PACKAGE).as_posix()


def named(file: Path) -> list[str]:
    """Return the effects and their parameters that stand in strings of a file's code."""
    tree = ast.parse(file.read_text("utf-8"))
    return [
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant)
        and isinstance(node.value, str)
        and NAME.fullmatch(node.value)
    ]


def test_no_effect_is_named_outside_its_own_file():
    found = {place(file): names for file in files() if (names := named(file))}
    assert found == {}
