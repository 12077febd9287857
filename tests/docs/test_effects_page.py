"""The page of effects is what the catalogue says."""

from __future__ import annotations

import runpy
from pathlib import Path

REFERENCE = Path(__file__).parents[2] / "docs" / "reference"


def test_the_page_of_effects_is_up_to_date() -> None:
    page = runpy.run_path(str(REFERENCE / "write_effects.py"))["page"]
    assert (REFERENCE / "effects.md").read_text("utf-8") == page(), (
        "run: python docs/reference/write_effects.py"
    )
