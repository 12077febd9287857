"""Script that writes `commands.md` from the inputs of all commands."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from benchtool.commands.app import COMMANDS, command_module
from benchtool.commands.input_commands import option_help
from benchtool.core.inputs import InputField, items

HEAD = """# Commands

This page lists the options of all commands, with allowed values and defaults in brackets. Written by
`python docs/reference/write_commands.py`.
"""
MIN_SHARED = 4  # a section with so many entries of an earlier one refers to it


def row(item: InputField) -> str:
    """Return the list entry of one option."""
    alias = f", `{item.metadata.alias}`" if item.metadata.alias else ""
    return f"- `{item.option}`{alias}: {option_help(item)}\n"


def page() -> str:
    """Return the text of `commands.md`."""
    parts = [HEAD]
    entries: dict[str, dict[str, str]] = {}
    for name, (location, line) in COMMANDS.items():
        if not location:
            continue
        function = getattr(import_module(command_module(name)), location.partition(":")[2])
        rows = {item.option: row(item) for item in items(function.inputs)}
        parts.append(f"\n## {name}\n\n{line}.\n")
        counts = {other: len(rows.items() & earlier.items()) for other, earlier in entries.items()}
        other = max(counts, key=lambda key: counts[key], default="")
        shared = [option for option in rows if rows[option] == entries.get(other, {}).get(option)]
        entries[name] = rows
        if len(shared) >= MIN_SHARED:
            options = ", ".join(f"`{option}`" for option in shared)
            parts.append(f"\nAs in [{other}](#{other.replace(' ', '-')}): {options}.\n")
            rows = {option: text for option, text in rows.items() if option not in shared}
        if rows:
            parts.append("\n" + "".join(rows.values()))
    return "".join(parts)


if __name__ == "__main__":
    (Path(__file__).parent / "commands.md").write_text(page(), "utf-8")
