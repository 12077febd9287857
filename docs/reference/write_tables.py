"""Script that writes the tables of registered items into the pages that people write.

A table is found by its header line.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from benchtool.bench.drivers import DRIVERS
from benchtool.data.formats.formats import BY_MAP, BY_NAMES, FORMATS
from benchtool.simulate.controllers.laws import FLIGHT_CONTROLLERS, PITCH_CONTROLLERS

DOCS = Path(__file__).parents[1]
TABLES: dict[str, list[tuple[str, Iterable[tuple[str, ...]]]]] = {  # by page: header and rows
    "how-to/connect": [
        (
            "| address | bench |",
            [(f"`{item.address.EXAMPLE}`", item.description) for item in DRIVERS.values()],
        )
    ],
    "how-to/extend": [
        (
            f"| {title} | what it does |",
            [(f"`{name}`", text) for name, text in controllers.items()],
        )
        for title, controllers in (
            ("controller", PITCH_CONTROLLERS),
            ("controller in flight", FLIGHT_CONTROLLERS),
        )
    ],
    "reference/import": [
        (
            "| format | detected by | reader |",
            [
                (item.name, item.detected_by, item.description)
                for item in (*FORMATS, BY_MAP, BY_NAMES)
            ],
        )
    ],
}


def page(name: str) -> str:
    """Return the text of a page with its tables written."""
    text = (DOCS / f"{name}.md").read_text("utf-8")
    for header, rows in TABLES[name]:
        before, table, after = text.partition(f"{header}\n")
        assert table, f"{name}.md has no table {header}"
        lines = [header, "|" + "---|" * (header.count("|") - 1)]
        lines += [f"| {' | '.join(row)} |" for row in rows]
        text = before + "\n".join(lines) + "\n\n" + after.partition("\n\n")[2]
    return text


if __name__ == "__main__":
    for name in TABLES:
        (DOCS / f"{name}.md").write_text(page(name), "utf-8")
