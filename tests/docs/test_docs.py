"""Every code block in the documentation does what its page says."""

from __future__ import annotations

from pathlib import Path

import pytest
from _pytest.mark import ParameterSet

from tests.docs.page import blocks_of, run_page

ROOT = Path(__file__).parents[2]
PAGES = [
    page
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    if any(block.is_run for block in blocks_of(page.read_text(encoding="utf-8")))
]


def as_case(page: Path) -> ParameterSet:
    blocks = [block for block in blocks_of(page.read_text(encoding="utf-8")) if not block.mark]
    serves = any(line.endswith("&") for block in blocks for line in block.commands())
    marks = [pytest.mark.real_time(deadline_s=0.1)] if serves else []
    return pytest.param(page, marks=marks, id=page.relative_to(ROOT).as_posix())


@pytest.mark.parametrize("page", [as_case(page) for page in PAGES])
def test_page(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    failures = run_page(page.read_text(encoding="utf-8"), str(page), tmp_path)
    assert failures == []


def test_a_wrong_exit_code_is_reported_with_its_line(tmp_path):
    page = "intro\n\n```sh\n$ benchtool no-such-command\n```\n"
    (failure,) = run_page(page, "page.md", tmp_path)
    assert failure.startswith("page.md:3: $ benchtool no-such-command\nexit code 2, expected 0")
    assert "unknown command" in failure
