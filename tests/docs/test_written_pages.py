"""Pages that scripts write are what the code says."""

from __future__ import annotations

import re
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
def test_a_written_page_is_up_to_date(name: str) -> None:
    folder, _, page = name.partition("/")
    script = DOCS / folder / f"write_{page.replace('-', '_')}.py"
    written = (DOCS / f"{name}.md").read_text("utf-8")
    assert written == runpy.run_path(str(script))["page"](), (
        f"run: python docs/{folder}/{script.name}"
    )


def test_the_readme_is_two_screens_with_a_picture_two_commands_and_five_links() -> None:
    text = (DOCS.parent / "README.md").read_text("utf-8")
    assert len(text.splitlines()) <= 60
    assert len(re.findall(r"(?m)^\$ ", text)) == 2
    targets = re.findall(r"\]\(([^)]+)\)", text)
    assert len(targets) == 1 + 5
    assert [target for target in targets if not (DOCS.parent / target).is_file()] == []
