"""The shape of the package: small folders, no circles, one meaning for each class name."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

from tests.architecture.tracked import ROOT, python_files

MOST_FILES = 25
CATALOGUES = {"benchtool/commands", "benchtool/physics/effects"}
"""One file a member: as long as the list of what the tool knows."""


def module_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def imported(tree: ast.Module, modules: set[str]) -> Iterator[str]:
    """Yield the package's modules that a file imports anywhere but for type checkers."""
    for_checkers = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        for inner in ast.walk(node)
    }
    for node in ast.walk(tree):
        if id(node) in for_checkers:
            continue
        if isinstance(node, ast.ImportFrom) and node.module:
            for name in node.names:
                inside = f"{node.module}.{name.name}"
                yield from {inside if inside in modules else node.module} & modules
        elif isinstance(node, ast.Import):
            yield from {name.name for name in node.names} & modules


def circles() -> set[frozenset[str]]:
    """Return groups of files that import each other, one circle at a time."""
    trees = {module_of(p): ast.parse(p.read_text("utf-8")) for p in python_files("benchtool")}
    graph = {name: set(imported(tree, set(trees))) - {name} for name, tree in trees.items()}
    found: set[frozenset[str]] = set()
    while True:
        try:
            TopologicalSorter(graph).prepare()
        except CycleError as error:
            circle = error.args[1]
            found.add(frozenset(circle))
            graph[circle[1]].discard(circle[0])
            graph[circle[0]].discard(circle[1])
        else:
            return found


def test_no_folder_is_crowded():
    files = Counter(
        path.parent.relative_to(ROOT).as_posix()
        for path in python_files("benchtool")
        if path.name != "__init__.py"
    )
    crowded = {folder for folder, count in files.items() if count > MOST_FILES}
    assert crowded <= CATALOGUES


def test_no_file_imports_one_that_imports_it():
    assert circles() == set()
