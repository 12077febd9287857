"""The help answers at once: no heavy library is imported for it, and no other command."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module
from inspect import getdoc

import pytest
import typer

from benchtool.commands.app import COMMANDS, module_of

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


def subcommands() -> list[list[str]]:
    """List the words of every command and subcommand."""
    words: list[list[str]] = [[]]
    for name in COMMANDS:
        words.append([name])
        group: typer.Typer | None = getattr(import_module(module_of(name)), "app", None)
        if group is not None:
            for command in group.registered_commands:
                assert command.callback is not None
                function_name = command.callback.__name__.replace("_", "-")
                words.append([name, command.name or function_name])
    return words


def ask_for_help(words: list[str]) -> tuple[str, int, set[str]]:
    """Run ``benchtool WORDS --help``; give what it printed, its exit code, the loaded modules."""
    answer = subprocess.run(
        [sys.executable, "-c", PROBE, *words, "--help"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert answer.stderr == ""
    printed, _, rest = answer.stdout.partition("\0\n")
    code, *modules = rest.split()
    return printed, int(code), set(modules)


@pytest.mark.parametrize("words", subcommands(), ids=lambda words: " ".join(words) or "benchtool")
def test_help_imports_nothing_heavy(words: list[str]) -> None:
    printed, code, modules = ask_for_help(words)
    assert code == 0
    assert printed.startswith(" ".join(["Usage: benchtool", *words]))
    assert modules.isdisjoint(HEAVY)
    others = {module_of(name) for name in COMMANDS if name not in words}
    assert modules.isdisjoint(others)


def test_help_lists_every_command_with_its_line() -> None:
    printed, _, _ = ask_for_help([])
    plain = " ".join(printed.split())
    assert [line for line in COMMANDS.values() if line not in plain] == []


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_has_one_description(name: str) -> None:
    module = import_module(module_of(name))
    if hasattr(module, "app"):
        assert isinstance(module.app, typer.Typer)
        return
    description = getdoc(module.command)
    assert description is not None
    assert description.splitlines()[0].rstrip(".") == COMMANDS[name].rstrip(".")
