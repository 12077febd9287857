"""Reference pages that scripts write are what the code says."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

REFERENCE = Path(__file__).parents[2] / "docs" / "reference"


@pytest.mark.parametrize("name", ["effects", "exit_codes"])
def test_a_written_page_is_up_to_date(name: str) -> None:
    script = REFERENCE / f"write_{name}.py"
    written = (REFERENCE / f"{name.replace('_', '-')}.md").read_text("utf-8")
    assert written == runpy.run_path(str(script))["page"](), (
        f"run: python docs/reference/{script.name}"
    )
