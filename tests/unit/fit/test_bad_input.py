"""What a fit says of data and options that it cannot use."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from benchtool.commands.app import main
from benchtool.fit.recipe import Recipe
from benchtool.fit.run_recipe import run_recipe

QUAD = Path(__file__).parents[3] / "datasets/quad/run"
LAB = "lab.csv --model lab.toml"
MODEL = """
[model]
name = "lab"
rig = "pquad_single"
[parameters]
k = { value = 1e-5, free = true, lower = 1e-7, upper = 1e-3 }
R_m = { value = 0.12, free = true }
[columns]
plate_z_m = { column = "gap_mm", unit = "mm" }
thrust_N = { column = "F_gf", unit = "gf" }
thrust_se_N = { column = "F_sd_gf", unit = "gf" }
rpm1 = { column = "speed", unit = "rpm" }
"""
ROWS = [
    "gap_mm,F_gf,F_sd_gf,speed",
    *("60,424.1,1.6,5500", "90,362.6,1.5,5500", "120,342.0,1.5,5500", "180,329.9,1.4,5500"),
    *("240,325.6,1.6,5500", "360,322.7,1.5,5500", "600,321.6,1.5,5500"),
]


@pytest.fixture
def lab(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("lab.toml").write_text(MODEL, "utf-8")
    Path("lab.csv").write_text("\n".join(ROWS), "utf-8")
    return tmp_path


def told(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str]:
    with pytest.raises(SystemExit) as left:
        main(["fit", *words])
    return int(str(left.value.code or 0)), capsys.readouterr().err.strip()


@pytest.mark.parametrize("gap_mm", ["0", "1e-15"])
def test_a_row_without_a_gap_is_left_out_without_a_warning(lab, gap_mm, capsys):
    Path("zero.csv").write_text("\n".join([*ROWS[:2], f"{gap_mm},424,1.6,5500", *ROWS[2:]]))
    assert told(capsys, "zero.csv", "--model", "lab.toml") == (0, "")
    output = run_recipe(Recipe(name="zero", data=("zero.csv",), model="lab.toml"))
    assert output.data.used.tolist() == [True, False, *[True] * 6]


@pytest.mark.parametrize("column", ["thrust_N", "thrust_ratio"])
def test_more_points_than_memory_allows_are_refused(lab, column, capsys):
    rows = "0.1,5000,1.1\n" * 10_001
    Path("many.csv").write_text(f"plate_z_m,rpm1,{column}\n{rows}")
    basis = ["--basis", "equal_rpm2"] if column == "thrust_ratio" else []
    code, err = told(capsys, "many.csv", "--model", "single", "--rig", "pquad_single", *basis)
    assert code == 2
    assert "10,001 points" in err


@pytest.mark.parametrize("column", [0, 1, 2, 3])
def test_a_row_with_an_empty_cell_is_left_out_and_counted(lab, column):
    cells = ROWS[3].split(",")
    cells[column] = ""
    Path("gap.csv").write_text("\n".join([*ROWS[:3], ",".join(cells), *ROWS[4:]]), "utf-8")
    output = run_recipe(Recipe(name="gap", data=("gap.csv",), model="lab.toml"))
    assert output.data.used.tolist() == [True, True, False, True, True, True, True]
    assert "1 of 7 points have an empty cell" in output.data.left_out[0]
    assert "data row 3" in output.data.left_out[0]
    whole = run_recipe(Recipe(name="lab", data=("lab.csv",), model="lab.toml")).results[0]
    assert output.results[0]["R_m"].value == pytest.approx(whole["R_m"].value, abs=0.002)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("", "no data to fit"),
        (f"{LAB} --basis equal_pwm", "kind 'reference'"),
        (f"{LAB} --free K_b", "unknown parameter 'K_b'"),
        (f"{LAB} --fix k=x", "'k=x'; write NAME=NUMBER"),
        (f"{QUAD} --model quad --where a=1 --columns c.toml", "--columns and --where"),
        (f"{LAB} --profile --loss huber", "--profile needs least squares with --loss linear"),
        (f"lab.csv {LAB}", "duplicate data: lab.csv and lab.csv"),
        (f"{QUAD.parent} --model quad", "neither a file nor a run folder"),
        (f"{LAB} --min-z-over-r 99", "none of 7 points"),
        (f"{LAB} --out .", "exists already"),
    ],
)
def test_what_cannot_be_used_is_said_with_exit_code_2(lab, capsys, words, said):
    code, text = told(capsys, *words.split())
    assert code == 2, text
    assert re.search(said, text), text
    assert "\n" not in text


def test_one_point_gives_no_answer_to_use(lab, capsys):
    Path("one.csv").write_text("\n".join(ROWS[:2]), "utf-8")
    with pytest.raises(SystemExit):
        main(["fit", "one.csv", "--model", "lab.toml", "--out", "one"])
    assert "No valid result from 1 of 1 points" in capsys.readouterr().out
    output = run_recipe(Recipe(name="one", data=("one.csv",), model="lab.toml"))
    assert output.results[0].outcome.status != "converged"
    assert not np.isfinite(output.results[0].covariance).all()
