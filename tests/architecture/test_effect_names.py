"""What is known of an effect stands in its own file: no room of the engine names one."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

import benchtool
from benchtool.physics.catalogue import EFFECTS

PACKAGE = Path(benchtool.__file__).parent
FREE_OF_NAMES = ("fit", "explain")
NAME = re.compile(rf"({'|'.join(EFFECTS)})(\.\w+)?")


def files() -> list[Path]:
    places = [PACKAGE / name for name in FREE_OF_NAMES]
    return [file for place in places for file in ([place] if place.suffix else place.rglob("*.py"))]


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


@pytest.mark.parametrize("file", files(), ids=lambda file: str(file.relative_to(PACKAGE)))
def test_no_effect_is_named(file: Path) -> None:
    assert named(file) == []
