"""`benchtool bench bridge` from outside: what it writes, what it says, what it leaves alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchtool.commands import app


def run(*words: str) -> int:
    with pytest.raises(SystemExit) as leaving:
        app.main(["bench", "bridge", *words])
    return int(leaving.value.code or 0)


def test_a_script_is_written_and_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "bridge.js"
    assert run("--out", str(out), "--host-port", "5001") == 0
    assert "var HOST_PORT = 5001;" in out.read_text("utf-8")
    said = capsys.readouterr().out
    assert "benchtool bench check rcbudp:127.0.0.1:55047?listen=5001" in said
    assert "a GUI that crashes or sleeps" in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--out", "taken.js"), "taken.js exists already and was left as it is"),
        (("--out", "bridge"), "is no name of a script; end it in .js"),
        (("--out", "nowhere/bridge.js"), "cannot be written"),
        (("--out", "x.js", "--rig", "pquad"), "has 4 rotors"),
        (("--out", "x.js", "--host", "lab"), "is no IPv4 address"),
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
    (tmp_path / "taken.js").write_text("mine")
    assert run(*words) == 2
    errors = capsys.readouterr().err
    assert said in errors
    assert len(errors.strip().splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["taken.js"]
