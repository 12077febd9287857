"""`benchtool flow`: table, picture, and an OpenFOAM case that hangs together."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchtool.cli.app import main


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


def test_a_case_that_hangs_together(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "case"
    assert run("export", "--out", str(out)) == 0
    for path in out.rglob("*"):
        if path.is_file() and path.suffix != ".md":
            text = path.read_text("utf-8")
            assert text.count("{") == text.count("}"), path
            assert text.count("(") == text.count(")"), path
    mesh = (out / "system/blockMeshDict").read_text("utf-8")
    patches = set(re.findall(r"^    (\w+) \{ type", mesh, re.MULTILINE))
    for name in ("U", "p", "k", "omega", "nut"):
        field = (out / "0" / name).read_text("utf-8")
        assert set(re.findall(r"^    (\w+) \{", field, re.MULTILINE)) == patches
    assert "U (0 0 -5.56" in (out / "constant/fvOptions").read_text("utf-8")  # sqrt(T/2 rho A)
    assert (out / "Allrun").stat().st_mode & 0o100
    assert run("export", "--out", str(out)) == 2
    assert run("export", "--out", str(tmp_path / "b"), "--rig", "amuse") == 2
    assert run("export", "--out", str(tmp_path / "b"), "--z-over-r", "9") == 2
    assert "z/R is 9" in capsys.readouterr().err
