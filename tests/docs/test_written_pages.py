"""Pages that scripts write are what the code says."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
PAGES = [
    "reference/commands",
    "reference/effects",
    "reference/exit-codes",
    "reference/figures",
    "reference/rig-keys",
    "reference/quantities",
    "explanation/architecture",
]


@pytest.mark.parametrize("name", PAGES)
def test_a_written_page_is_up_to_date(name):
    folder, _, page = name.partition("/")
    script = DOCS / folder / f"write_{page.replace('-', '_')}.py"
    written = (DOCS / f"{name}.md").read_text("utf-8")
    assert written == runpy.run_path(str(script))["page"](), (
        f"run: python docs/{folder}/{script.name}"
    )


def test_the_stub_is_up_to_date():
    script = runpy.run_path(str(DOCS / "reference/write_stub.py"))
    assert script["PAGE"].read_text("utf-8") == script["page"](), (
        "run: python docs/reference/write_stub.py"
    )


TABLES = runpy.run_path(str(DOCS / "reference/write_tables.py"))


@pytest.mark.parametrize("name", TABLES["TABLES"])
def test_a_written_table_is_up_to_date(name):
    written = (DOCS / f"{name}.md").read_text("utf-8")
    assert written == TABLES["page"](name), "run: python docs/reference/write_tables.py"
