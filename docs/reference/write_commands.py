"""Write `commands.md` from the inputs of every command: python docs/reference/write_commands.py."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from benchtool.commands.app import COMMANDS, command_module
from benchtool.core.input_text import format_value
from benchtool.core.inputs import InputField, items

HEAD = """# Commands

Written by `python docs/reference/write_commands.py` from the commands' inputs (tested). A value
outside its range is refused wherever it comes from: an option, the page, a plan or recipe file, or
a call from Python.
"""


def row(item: InputField) -> str:
    """Return the table's row of one input."""
    also = f", `{item.metadata.alias}`" if item.metadata.alias else ""
    taken = ", ".join(item.choices) or f"{item.range} {item.metadata.unit}".strip()
    usual = item.metadata.default_text or (
        "" if item.required or item.kind is bool else format_value(item.default)
    )
    cells = (f"`{item.option}`{also}", item.metadata.help, taken, usual)
    return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |\n"


def page() -> str:
    """Return the text of `commands.md`."""
    parts = [HEAD]
    for name, (where, line) in COMMANDS.items():
        if not where:
            continue
        called = getattr(import_module(command_module(name)), where.partition(":")[2])
        parts.append(f"\n## {name}\n\n{line}.\n")
        if rows := "".join(map(row, items(called.inputs))):
            parts.append(
                f"\n| option | meaning | takes | when left out |\n|---|---|---|---|\n{rows}"
            )
    return "".join(parts)


if __name__ == "__main__":
    (Path(__file__).parent / "commands.md").write_text(page(), "utf-8")
