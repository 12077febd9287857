"""`benchtool firmware` from outside: what it writes, what it says, what it leaves alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchtool.commands import app


def run(*words: str) -> int:
    with pytest.raises(SystemExit) as leaving:
        app.main(["firmware", *words])
    return int(leaving.value.code or 0)


def test_a_folder_is_made_and_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "new" / "my_bench"
    assert run("--board", "uno", "--out", str(out), "--device-id", "bench-01") == 0
    said = capsys.readouterr().out
    assert "Arduino Uno R3, device bench-01" in said
    assert (out / "my_bench.ino").exists()
    assert '"bench-01"' in (out / "settings.h").read_text("utf-8")


def test_two_devices_never_share_a_name(tmp_path: Path) -> None:
    for name in ("one", "two"):
        assert run("--out", str(tmp_path / name)) == 0
    one, two = ((tmp_path / name / "settings.h").read_text("utf-8") for name in ("one", "two"))
    assert one != two


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--board", "mega", "--out", "bench"), "unknown board 'mega'; known: nano, uno"),
        (("--rig", "pquad", "--out", "bench"), "has 4 motors"),
        (("--out", "taken"), "taken exists already and was left as it is"),
        (("--out", "taken/file/bench"), "cannot be written"),
        ((), "Missing option '--out'"),
    ],
)
def test_bad_words_are_refused_in_one_sentence(
    words: tuple[str, ...],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "file").write_text("mine")
    assert run(*words) == 2
    errors = capsys.readouterr().err
    assert said in errors
    assert len(errors.strip().splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]
