"""The shape of the package: small folders, no circles, one meaning for each class name."""

from __future__ import annotations

from collections import Counter
from graphlib import TopologicalSorter

from grimp import build_graph

from tests.architecture.tracked import ROOT, python_files

MOST_FILES = 25
CATALOGUES = {"benchtool/commands", "benchtool/physics/effects"}
"""One file a member: as long as the list of what the tool knows."""


def test_no_folder_is_crowded():
    files = Counter(
        path.parent.relative_to(ROOT).as_posix()
        for path in python_files("benchtool")
        if path.name != "__init__.py"
    )
    crowded = {folder for folder, count in files.items() if count > MOST_FILES}
    assert crowded <= CATALOGUES


def test_no_file_imports_one_that_imports_it():
    """Imports for type checkers apart; a circle is raised as a CycleError."""
    graph = build_graph("benchtool", exclude_type_checking_imports=True, cache_dir=None)
    files = {name: graph.find_modules_directly_imported_by(name) for name in graph.modules}
    assert len(list(TopologicalSorter(files).static_order())) == len(files)
