from __future__ import annotations

from pathlib import Path

import pytest

from benchtool.core.errors import InputError
from benchtool.data.run.state import recall, remember


def test_what_is_remembered_is_recalled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BENCHTOOL_STATE", str(tmp_path / "state"))
    assert recall("checked", "a/b") is None
    path = remember("checked", "a/b", {"date": "2026-01-31"})
    assert path.parent == tmp_path / "state" / "checked"
    assert recall("checked", "a/b") == {"date": "2026-01-31"}


def test_a_state_folder_that_cannot_be_written_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("BENCHTOOL_STATE", str(tmp_path / "file"))
    with pytest.raises(InputError, match="environment variable BENCHTOOL_STATE"):
        remember("checked", "a", {})
