"""A fit without an answer, or whose model the data reject, never ends like a good one."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchtool.commands.app import main
from benchtool.data.run.entry import build_entry
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.physics.model_file import load_model

FAR = "rpm1,thrust_N,thrust_se_N\n4000,1.81,0.01\n5000,2.83,0.01\n6000,4.08,0.01\n7000,5.56,0.01\n"
NEAR = """plate_z_m,rpm1,thrust_N,thrust_se_N
0.07,5500,4.6,0.001
0.12,5500,3.2,0.001
0.18,5500,3.9,0.001
0.24,5500,3.1,0.001
0.36,5500,3.6,0.001
0.60,5500,3.4,0.001
"""


def fitted(folder: Path, table: str, *words: str) -> int:
    (folder / "table.csv").write_text(table)
    request = ["fit", str(folder / "table.csv"), "--model", "single", "--rig", "pquad_single"]
    with pytest.raises(SystemExit) as left:
        main([*request, "--out", str(folder / "fit"), *words])
    return int(left.value.code or 0)


def test_no_answer_is_exit_6_and_no_model(tmp_path, capsys):
    assert fitted(tmp_path, FAR) == 6
    said = capsys.readouterr()
    assert "these data do not determine R_m" in said.err
    assert not (tmp_path / "fit" / "model.toml").exists()
    result = json.loads((tmp_path / "fit" / "result.json").read_text())
    assert result["answer"] == "none"
    assert result["problem"].startswith("least_squares: these data do not determine R_m")
    assert build_entry(RunsFolder(tmp_path), "fit").state == "stopped early"


def test_a_rejected_model_is_exit_9_and_says_so_in_every_file(tmp_path, capsys):
    assert fitted(tmp_path, NEAR) == 9
    said = capsys.readouterr()
    assert "the data reject model 'single': points scatter" in said.err
    result = json.loads((tmp_path / "fit" / "result.json").read_text())
    assert result["answer"] == "model rejected"
    model = load_model(tmp_path / "fit" / "model.toml").model
    assert model.provenance["rejected"].startswith("the data reject model 'single'")
    assert "The model is rejected" in (tmp_path / "fit" / "report.html").read_text()
    assert build_entry(RunsFolder(tmp_path), "fit").state == "model rejected"


def test_a_good_fit_is_exit_0(tmp_path):
    assert fitted(tmp_path, FAR, "--fix", "R_m") == 0
    result = json.loads((tmp_path / "fit" / "result.json").read_text())
    assert (result["answer"], result["problem"]) == ("given", "")
    assert "rejected" not in load_model(tmp_path / "fit" / "model.toml").model.provenance


"""k = 2.68e-8 N/(rad/s)^2, as a motor of 20 g has."""
