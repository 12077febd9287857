"""The pages as a site: built without a warning, and read without another host."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        importlib.util.find_spec("mkdocs") is None, reason="mkdocs is not installed (`make docs`)"
    ),
]


class Loaded(HTMLParser):
    """Collects what a page loads, and what it links to."""

    def __init__(self) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        (self.links if tag == "a" else self.loads).extend(
            address for name in ("href", "src", "srcset", "data") if (address := given.get(name))
        )


def build(source: Path, site: Path) -> str:
    """Build as `make docs` does; return the exit code and the lines that are no information.

    Without ``--quiet``: it would hide warnings from strict mode, too.
    """
    ended = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--site-dir", str(site)],
        cwd=source,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1", "NOTEBOOKS": "unrun"},
        capture_output=True,
        encoding="utf-8",
        timeout=120,
        check=False,
    )
    lines = (ended.stdout + ended.stderr).splitlines()
    return "\n".join([str(ended.returncode), *(one for one in lines if not one.startswith("INFO"))])


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    assert build(ROOT, folder) == "0"
    return folder


def test_every_page_is_there_and_in_the_navigation(site):
    index = Loaded()
    index.feed((site / "index.html").read_text("utf-8"))
    sources = {*DOCS.rglob("*.md"), *DOCS.rglob("*.ipynb")} - {DOCS / "README.md"}
    pages = {page.relative_to(DOCS).with_suffix(".html").as_posix() for page in sources}
    assert pages <= set(index.links)
    assert [page for page in pages if not (site / page).is_file()] == []


def test_nothing_is_loaded_from_another_host(site):
    for page in site.rglob("*.html"):
        found = Loaded()
        text = page.read_text("utf-8")
        found.feed(text)
        assert [url for url in found.loads if re.match(r"(\w+:)?//", url)] == [], page
        assert 'class="mermaid"' not in text, "the theme loads mermaid from another host"
    for sheet in site.rglob("*.css"):
        assert re.findall(r"url\(['\"]?(?:\w+:)?//[^)]*", sheet.read_text("utf-8")) == []


def test_the_python_page_has_every_public_name_with_its_text(site):
    import benchtool

    text = (site / "reference" / "python.html").read_text("utf-8")
    for name in set(benchtool.__all__) - {"__version__"}:
        assert f'id="benchtool.api.{name}"' in text, name
    assert "Read a run folder, a recording" in text


def test_a_broken_link_and_a_missing_heading_are_refused(tmp_path):
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "index.md").write_text("# A\n\n[b](b.md), [c](#c)\n")
    settings = (ROOT / "mkdocs.yml").read_text("utf-8").replace("hooks: [", f"hooks: [{ROOT}/")
    (tmp_path / "mkdocs.yml").write_text(settings)
    printed = build(tmp_path, tmp_path / "site")
    assert "link 'b.md'" in printed
    assert "link '#c'" in printed
    assert "Aborted with 2 warnings" in printed
