"""`benchtool flow`: table and picture."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchtool.commands.app import main


def run(*words: str) -> int:
    with pytest.raises(SystemExit) as leaving:
        main(["flow", *words])
    return int(leaving.value.code or 0)


@pytest.mark.slow
def test_table_and_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("table") == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[1].split()[3:] == ["-0.014", "-0.026", "-0.037", "-0.013", "+0.014", "+0.046"]
    assert "prescribed wake, not CFD" in printed[-1]
    assert run("picture", "--out", str(tmp_path)) == 0
    svg = (tmp_path / "fig05-flow.svg").read_text("utf-8")
    assert svg.startswith("<?xml")
    assert (tmp_path / "fig05-flow.png").stat().st_size > 50_000
