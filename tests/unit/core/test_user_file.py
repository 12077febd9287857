"""A path that somebody names is a regular file of bounded size, or a sentence; nothing blocks."""

from __future__ import annotations

import os

import pytest

from benchtool.core.errors import FileFormatError
from benchtool.core.toml_text import parse_json, parse_toml
from benchtool.core.user_file import open_file, read_text


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("nothing", "no such file"),
        ("file/below", "(?i)not a directory"),
        ("folder", "this is a folder"),
        ("fifo", "this is a pipe"),
        ("/dev/zero", "this is a device"),
        ("ring", "links lead in a circle|not followed"),
        ("a" * 300, "file name too long"),
        ("nul\0", "not a valid file name"),
        ("\ud800", "not a valid file name"),
        ("large", "it has 11 bytes, limit 10"),
        ("bytes", r"not UTF-8 text \(byte 1 is 0xff\)"),
    ],
)
def test_what_is_no_text_file_is_refused(tmp_path, name, says):
    (tmp_path / "file").touch()
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "ring").symlink_to(tmp_path / "ring")
    (tmp_path / "large").write_bytes(b"x" * 11)
    (tmp_path / "bytes").write_bytes(b"a\xff")
    with pytest.raises(FileFormatError, match=says):
        read_text(tmp_path / name, 10)


def test_a_link_is_followed_only_where_that_is_wanted(tmp_path):
    (tmp_path / "file").write_text("text")
    (tmp_path / "link").symlink_to(tmp_path / "file")
    assert read_text(tmp_path / "link") == "text"
    with pytest.raises(FileFormatError, match="symbolic link, which is not followed"):
        open_file(tmp_path / "link", follow=False)


DEEP = "[" * 3000
DIGITS = "1" * 4400


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (f"a = {DEEP}", "nested deeper than 32 levels|not valid TOML"),
        (f"a = {DEEP}{']' * 3000}", "nested deeper than 32 levels"),
        (f"a = {'[' * 40}{']' * 40}", "nested deeper than 32 levels"),
        (f"a = {'{b = ' * 400}1{'}' * 400}", "nested deeper than 32 levels"),
        (f"a = {DIGITS}", "beyond 9223372036854775807"),
        ("a = 9223372036854775808", "beyond 9223372036854775807"),
        ("a = 0x8000000000000000", "beyond 9223372036854775807"),
        ("a = ]", "not valid TOML"),
    ],
    ids=range(8),
)
def test_toml_beyond_its_bounds_is_refused(text, says):
    with pytest.raises(FileFormatError, match=says):
        parse_toml(text, "x.toml")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (f"{DEEP}{']' * 3000}", "nested deeper than 32 levels"),
        ('{"a": ' * 40 + "1" + "}" * 40, "nested deeper than 32 levels"),
        (DIGITS, "beyond 9223372036854775807"),
        ("-9223372036854775809", "beyond 9223372036854775807"),
        ('{"a": NaN}', "NaN is no number"),
        ("[-Infinity]", "-Infinity is no number"),
        ("[1e400]", "beyond 1.8e308"),
        ('["\\ud800"]', "is not valid text"),
        ('{"\\udfff": 1}', "is not valid text"),
        ("{", "not valid JSON"),
        (b"\xff\xff", "not valid JSON"),
    ],
    ids=range(11),
)
def test_json_beyond_its_bounds_is_refused(text, says):
    with pytest.raises(FileFormatError, match=says):
        parse_json(text, "x.json")
