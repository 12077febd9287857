"""The help answers at once: no heavy library is imported for it, and no other command."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from benchtool.commands.app import COMMANDS, command_module

HEAVY = (
    "numpy", "numba", "scipy", "emcee", "matplotlib", "pandas", "pyarrow", "serial", "pymavlink",
    "pydantic", "jinja2", "psutil", "rich",
)  # fmt: skip

PROBE = """
import sys
from benchtool.commands.app import main
try:
    main(sys.argv[1:])
except SystemExit as leaving:
    print("\\0", leaving.code or 0, *sys.modules, sep="\\n")
"""


def run_and_list_modules(words: list[str], folder: Path | None = None) -> tuple[str, int, set[str]]:
    """Run ``benchtool WORDS``; give what it printed, its exit code, the loaded modules."""
    answer = subprocess.run(
        [sys.executable, "-c", PROBE, *words],
        capture_output=True,
        text=True,
        check=True,
        cwd=folder,
    )
    printed, _, rest = answer.stdout.partition("\0\n")
    code, *modules = rest.split()
    assert (answer.stderr == "") == (code == "0")
    return printed, int(code), set(modules)


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help_imports_nothing_heavy(command):
    words = command.split()
    printed, code, modules = run_and_list_modules([*words, "--help"])
    assert code == 0
    assert printed.startswith(" ".join(["Usage: benchtool", *words]))
    assert modules.isdisjoint(HEAVY)
    own = command_module(command) if command else ""
    others = {command_module(name) for name, (where, _) in COMMANDS.items() if where} - {own}
    others |= set() if command else {"benchtool.core.inputs"}
    assert modules.isdisjoint(others)


UNUSED = {  # by a fit without report; `corner`, `jinja2` and matplotlib draw, emcee samples
    "corner", "emcee", "jinja2", "matplotlib", "numba", "pandas", "pymavlink",
    "scipy.ndimage", "scipy.signal", "scipy.stats",
}  # fmt: skip


@pytest.mark.parametrize(
    ("line", "code", "more"),
    [
        ("fit t.csv --model single --rig pquad_single", 0, {"benchtool.explain.request"}),
        ("fit t.csv --model nothing", 2, {"numpy", "pydantic"}),
        ("fit no.csv", 2, {"numpy", "pydantic"}),
        ("fit t.csv --nothing", 2, {"numpy", "pydantic"}),
        ("fit t.csv", 2, {"scipy", "pydantic"}),
        ("pool a", 2, {"scipy"}),
        ("report nothing", 2, {"scipy", "rich"}),
        ("motor nothing", 2, {"numpy"}),
        ("export nothing --to c", 2, {"numpy"}),
        ("explain", 2, {"scipy"}),
        ("record sim:nothing", 2, {"scipy", "rich"}),
        ("simulate flight --model nothing", 2, {"numpy"}),
        ("simulate flight --case nothing", 2, {"scipy.optimize"}),
        ("library models", 0, {"scipy"}),
        ("sweep sim:nothing", 2, {"scipy"}),
    ],
)
def test_a_command_imports_only_what_it_uses(line, code, more, tmp_path):
    rows = "".join(f"{z},{3.2 + 0.01 / z**2},6000\n" for z in (0.08, 0.1, 0.13, 0.2, 0.4, 0.8))
    (tmp_path / "t.csv").write_text(f"plate_z_m,thrust_N,rpm1\n{rows}", "utf-8")
    _, found, modules = run_and_list_modules(line.split(), tmp_path)
    assert (found, modules & (UNUSED | more)) == (code, set())


def test_no_extra_is_imported_to_drive_a_bench():
    program = """
import importlib, pkgutil, sys
import benchtool, benchtool.bench, benchtool.acquire
for name in benchtool.__all__:
    getattr(benchtool, name)
for package in (benchtool.bench, benchtool.acquire):
    for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        importlib.import_module(module.name)
print(sorted({"duckdb", "dask", "distributed", "mcap"} & {*sys.modules}))
"""
    answer = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert answer.stdout == "[]\n", answer.stderr


def test_no_extra_is_a_dependency():
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text("utf-8"))
    needed = " ".join(project["project"]["dependencies"])
    extras = project["project"]["optional-dependencies"]
    optional = {one.partition(">")[0] for name in ("catalogue", "cluster", "mcap")
                for one in extras[name]} - {"protobuf"}  # fmt: skip
    assert {"duckdb", "distributed", "mcap"} <= optional
    assert [name for name in optional if name in needed] == []


def test_the_parse_numbers_a_table_are_read_without_pandas():
    """Arrow's conversion to NumPy imports it where a cell is blank, and for no use."""
    program = """
import sys
from benchtool.data.csv_text import parse_rows
from benchtool.data.repairs.column_mapping import parse_numbers
table = parse_rows(b"a,b\\n1,2.5\\n,3\\n4,5\\n", "x.csv")
print(parse_numbers(table, (0, 1)).columns.tolist(), "pandas" in sys.modules)
"""
    answer = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert answer.stdout == "[[1.0, nan, 4.0], [2.5, 3.0, 5.0]] False\n", answer.stderr
