"""Every test that a page names as its proof is there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NAMED = re.compile(r"`(?:tests/)?((?:[a-z_]+/)+test_\w+\.py)(?:::(\w+))?`")


@pytest.mark.parametrize("page", ["proof", "safety"])
def test_every_test_that_a_page_names_is_there(page):
    text = (ROOT / f"docs/explanation/{page}.md").read_text("utf-8")
    named = NAMED.findall(text)
    assert named
    for file, test in named:
        path = ROOT / "tests" / file
        assert path.is_file(), file
        assert not test or f"\ndef {test}(" in path.read_text("utf-8"), f"{file}::{test}"
