"""Strict reading in general: sources, unknown keys, wrong types."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import pytest

from benchtool.core.errors import FileFormatError, UnknownChoice
from benchtool.core.toml_text import FileTable, parse_quantities, read_strict


@dataclass(frozen=True, slots=True, kw_only=True)
class Inner(FileTable):
    size_m: float
    count: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Outer(FileTable):
    name: str
    inner: Inner | None = None
    many: tuple[Inner, ...] = ()
    by_name: Mapping[str, Inner] = field(default_factory=dict)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name = 'a'\nnam = 1", r"key in a.toml 'nam'; did you mean 'name'\?"),
        ("name = 'a'\n[inner]\nsize_mm = 1", r"\[inner\] of a.toml 'size_mm'.*size_m"),
        ("name = 'a'\n[[many]]\nsize_m = 1\nx = 2", r"\[many\[0\]\] of a.toml 'x'; known: count"),
        ("name = 'a'\n[by_name.q]\nsize_m = 1\nx = 2", r"\[by_name.q\].*known: count, size_m"),
    ],
)
def test_an_unknown_key_is_refused_with_the_known_ones(text, words):
    with pytest.raises(UnknownChoice, match=words):
        read_strict(Outer, text, "a.toml")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "a.toml: name is missing; add it"),
        ("name = 3", "a.toml: name is 3: .*string"),
        ("name = 'a'\n[inner]\nsize_m = true", "inner.size_m is true: .*number"),
        ("name = 'a'\n[inner]\nsize_m = '1'", 'inner.size_m is "1": .*number'),
        ("name = 'a'\n[inner]\nsize_m = 1\ncount = 1.5", "inner.count is 1.5: .*integer"),
        ("name == 1", "not valid TOML: .*line 1"),
    ],
)
def test_a_wrong_value_is_said_with_its_key(text, words):
    with pytest.raises(FileFormatError, match=words):
        read_strict(Outer, text, "a.toml")


def test_sources_are_found_at_the_number_or_its_table():
    text = (
        "[a]\nsource = 'assumed: all of it'\nx = 1\ny = { value = 2, source = 'measured' }\n"
        "[a.b]\nz = 3\n"
    )
    data, found = parse_quantities(text, "a.toml")
    assert data == {"a": {"x": 1, "y": 2, "b": {"z": 3}}}
    assert found.by_key == {
        "a.x": "assumed: all of it",
        "a.y": "measured",
        "a.b.z": "assumed: all of it",
    }
    assert found.assumed == ["a.x", "a.b.z"]
    with pytest.raises(FileFormatError, match=r"c\.w has no source"):
        parse_quantities(f"{text}[c]\nw = 4", "a.toml")
