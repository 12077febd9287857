"""Plural form of a count with its noun: 1 row, 2,000 rows."""

from __future__ import annotations


def pluralize(count: int, noun: str) -> str:
    """Return a count with its noun, which takes an s unless the count is 1."""
    return f"{count:,} {noun}" if count == 1 else f"{count:,} {noun}s"
