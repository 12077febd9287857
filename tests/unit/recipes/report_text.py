"""Read a report page as a person would: its words, its facts, its tables; and its PDF."""

from __future__ import annotations

import re
import zlib
from html import unescape


def words_of(page: str) -> str:
    """Return a page's text without markup, styles and drawings."""
    for tag in ("style", "svg"):
        page = re.sub(rf"<{tag}\b.*?</{tag}>", " ", page, flags=re.DOTALL)
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", page)).split())


def facts_of(page: str) -> dict[str, str]:
    """Return the names and values of every list of facts."""
    pairs = re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", page, flags=re.DOTALL)
    return {unescape(name): unescape(value) for name, value in pairs}


def rows_of(page: str, caption: str) -> list[list[str]]:
    """Return the cells of the first table whose caption holds these words."""
    for table in re.findall(r"<table>.*?</table>", page, flags=re.DOTALL):
        told = re.search(r"<caption>(.*?)</caption>", table, flags=re.DOTALL)
        if told and caption in unescape(told[1]):
            body = table.split("<tbody>")[1]
            return [
                [unescape(cell) for cell in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row)]
                for row in body.split("</tr>")[:-1]
            ]
    raise AssertionError(f"no table {caption!r}")


def check_self_contained(page: str) -> None:
    """Assert that a page fetches nothing from anywhere."""
    assert not re.search(r"\b(https?|ftp|file)://|@import|//[a-z]+\.", page)
    assert not re.search(r"<(script|link|iframe|img|object)\b", page)
    links = re.findall(r'\b(?:href|src)="([^"]*)"', page)
    assert all(link.startswith(("#", "data:image/")) for link in links)


def pdf_pages(content: bytes) -> int:
    """Return how many pages a PDF has."""
    counts = re.findall(rb"/Type /Pages.*?/Count (\d+)", _unpacked(content), flags=re.DOTALL)
    return max(int(count) for count in counts)


def pdf_text(content: bytes) -> str:
    """Return the text of a PDF in the order of drawing, by its fonts' tables of characters."""
    text = _unpacked(content)
    tables = dict(re.findall(rb"\n(\d+) 0 obj\n[^\n]*\nstream\n(.*?)\nendstream", text, re.DOTALL))
    fonts = {}
    for name, number in re.findall(rb"/BaseFont /(\w+)\+[\w-]+/ToUnicode (\d+) 0 R", text):
        pairs = re.findall(rb"<([0-9a-f]{4})> <([0-9a-f]+)>", tables[number])
        fonts[name] = {glyph: bytes.fromhex(to.decode()).decode("utf-16-be") for glyph, to in pairs}
    said, font = [], fonts[next(iter(fonts))]
    for name, shown in re.findall(rb"/(\w+) [\d.]+ Tf|\[([^\]]*)\] TJ", text):
        if name:
            font = fonts.get(name, {})
            continue
        glyphs = b"".join(re.findall(rb"<([0-9a-f]*)>", shown))
        said.append("".join(font.get(glyphs[i : i + 4], "") for i in range(0, len(glyphs), 4)))
    return " ".join(said)


def _unpacked(content: bytes) -> bytes:
    def whole(found: re.Match[bytes]) -> bytes:
        try:
            return b"stream\n" + zlib.decompress(found[1]) + b"\nendstream"
        except zlib.error:
            return found[0]

    return re.sub(rb"stream\r?\n(.*?)\r?\nendstream", whole, content, flags=re.DOTALL)
