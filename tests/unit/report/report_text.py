"""Read a report page as a person would: its words, its facts, its tables."""

from __future__ import annotations

import re
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
