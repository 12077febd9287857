from __future__ import annotations

from pathlib import Path

import pytest

from benchtool.core.errors import InputError
from benchtool.data.run.state import recall, remember, state_folder


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


def test_the_state_folder_follows_the_system(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("BENCHTOOL_STATE", raising=False)
    monkeypatch.setenv("XDG_STATE_HOME", "/somewhere")
    monkeypatch.setattr("sys.platform", "linux")
    assert state_folder() == Path("/somewhere/benchtool")
    monkeypatch.setattr("sys.platform", "darwin")
    assert state_folder().parts[-3:] == ("Library", "Application Support", "benchtool")
