"""Every class that an element is given is one that a style sheet or a script of the page knows."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import nicegui

import benchtool.web

OURS = Path(benchtool.web.__file__).parent
THEIRS = Path(nicegui.__file__).parent / "static"


def given() -> dict[str, str]:
    """Return every class that is given to an element in so many words, with the file."""
    found = {}
    for path in OURS.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Attribute)
                and node.func.attr == "classes"
            ):
                words = [*node.args, *(word.value for word in node.keywords)]
                texts = [word.value for word in words if isinstance(word, ast.Constant)]
                names = [name for text in texts for name in str(text).split()]
                found |= dict.fromkeys(names, path.name)
    return found


def known() -> set[str]:
    """Return every class that a style sheet names, or a script of ours looks for."""
    sheets = [*(OURS / "static").iterdir(), *THEIRS.glob("*.css")]
    # A dot may stand before a letter only: numbers such as 0.25rem have none.
    return {
        name
        for sheet in sheets
        for name in re.findall(r"\.(-?[_a-zA-Z][\w-]*)", sheet.read_text("utf-8"))
    }


def test_no_class_is_without_a_rule() -> None:
    classes = given()
    assert "w-full" in classes
    assert {name: path for name, path in classes.items() if name not in known()} == {}
