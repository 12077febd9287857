from __future__ import annotations

import os
from pathlib import Path

import pytest

from benchtool.web.serve import open_page

PLAIN = "http://127.0.0.1:8460/"


@pytest.mark.skipif(os.name != "posix", reason="permissions of files are those of POSIX")
def test_a_token_stands_in_a_file_of_this_user_and_on_no_command_line(tmp_path: Path) -> None:
    opened: list[str] = []
    old = os.umask(0)
    try:
        file = open_page(f"{PLAIN}?token=secret", tmp_path, opened.append)
    finally:
        os.umask(old)
    assert file is not None
    assert opened == [file.as_uri()]
    assert "secret" not in opened[0]
    assert file.stat().st_mode & 0o777 == 0o600
    assert f"url={PLAIN}?token=secret" in file.read_text("utf-8")


def test_an_address_without_a_token_is_opened_as_it_is(tmp_path: Path) -> None:
    opened: list[str] = []
    assert open_page(PLAIN, tmp_path, opened.append) is None
    assert opened == [PLAIN]
    assert list(tmp_path.iterdir()) == []
