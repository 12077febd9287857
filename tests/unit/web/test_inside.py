from __future__ import annotations

from pathlib import Path

import pytest

from benchtool.errors import InputError
from benchtool.web.inside import inside


def test_names_in_the_folder_are_found(tmp_path: Path) -> None:
    assert inside(tmp_path, "a/b") == tmp_path.resolve() / "a" / "b"
    assert inside(tmp_path, "a/../b") == tmp_path.resolve() / "b"


@pytest.mark.parametrize(
    "name", ["..", "../x", "a/../../x", "/etc/passwd", "", "  ", ".", "a/..", "x\0y"]
)
def test_everything_else_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="reads and writes that folder only"):
        inside(tmp_path, name)


def test_a_link_that_leads_out_is_refused(tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    (tmp_path / "secret").write_text("x")
    (tmp_path / "runs" / "link").symlink_to(tmp_path / "secret")
    with pytest.raises(InputError):
        inside(tmp_path / "runs", "link")
