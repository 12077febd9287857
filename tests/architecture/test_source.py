"""What holds for every file of the project."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from tests.architecture.tracked import ROOT, project_files, python_files, text_of

LONGEST = 400
# Written in pieces, so that this file does not hold what it looks for.
REGISTRY = re.compile(
    "|".join(
        [
            "pypi" + r"\.org",
            "python" + "hosted",
            "conda" + r"\.anaconda",
            "registry" + r"\.npm",
            "--(extra-)?index-" + "url",
        ]
    ),
    re.IGNORECASE,
)
MACHINE_PATH = re.compile(r"(?<![\w./~}-])/(?:home/\w|Users/\w|root/|work/|mnt/\w)")
CHECKS = ("raises", "warns", "deprecated_call", "fail", "expect")


def relative(path: Path) -> str:
    """Name a file from the top of the project."""
    return path.relative_to(ROOT).as_posix()


def test_no_file_of_the_package_is_long():
    lengths = {
        relative(p): len(p.read_text("utf-8").splitlines()) for p in python_files("benchtool")
    }
    assert {name: n for name, n in lengths.items() if n > LONGEST} == {}


@pytest.mark.parametrize("pattern", [REGISTRY, MACHINE_PATH], ids=["registry", "machine path"])
def test_no_file_names_a_registry_or_a_path_of_one_machine(pattern):
    found = [
        f"{relative(path)}:{number}: {line.strip()[:80]}"
        for path in project_files()
        if path.suffix not in {".csv", ".jsonl"} and (text := text_of(path)) is not None
        for number, line in enumerate(text.splitlines(), 1)
        if pattern.search(line)
    ]
    assert found == []


def asserts_something(test: ast.AST) -> bool:
    """Tell whether a test asserts, expects an exception or calls a helper named check_*.

    `expect` is the waiting assertion of the browser tests.
    """
    for node in ast.walk(test):
        if isinstance(node, ast.Assert):
            return True
        if isinstance(node, ast.Call):
            called = node.func
            name = called.attr if isinstance(called, ast.Attribute) else getattr(called, "id", "")
            if name in CHECKS or name.startswith(("check_", "assert_")):
                return True
    return False


def test_every_test_asserts_something():
    silent = [
        f"{relative(path)}:{node.lineno} {node.name}"
        for path in python_files("tests")
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and node.name.startswith("test")
        and not asserts_something(node)
    ]
    assert silent == []


def test_optimisers_are_called_in_fit_and_bounded_least_squares_only():
    """Keep what import-linter cannot see: it knows scipy only as a whole."""
    homes = (ROOT / "benchtool/fit", ROOT / "benchtool/explain/engine/bounded_least_squares.py")
    strays = [
        relative(path)
        for path in python_files("benchtool")
        if "scipy.optimize" in path.read_text("utf-8")
        and not any(path.is_relative_to(home) for home in homes)
    ]
    assert strays == []


def test_nothing_waits_for_somebody_to_finish_it():
    marks = re.compile("TO" + "DO|FIX" + "ME|XX" + "X")
    found = [
        f"{relative(path)}:{number}"
        for folder in ("benchtool", "tests")
        for path in python_files(folder)
        for number, line in enumerate(path.read_text("utf-8").splitlines(), 1)
        if marks.search(line)
    ]
    assert found == []
