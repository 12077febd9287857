"""What a fit says of data and options that it cannot use."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchtool.commands.app import main
from benchtool.fit.recipe import Recipe
from benchtool.fit.run_recipe import run_recipe

QUAD = Path(__file__).parents[3] / "datasets/quad/run"
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
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("lab.toml").write_text(MODEL, "utf-8")
    Path("lab.csv").write_text("\n".join(ROWS), "utf-8")
    return tmp_path


def told(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str]:
    with pytest.raises(SystemExit) as left:
        main(["fit", *words])
    return int(str(left.value.code or 0)), capsys.readouterr().err.strip()


@pytest.mark.parametrize("gap_mm", ["0", "1e-15"])
def test_a_row_without_a_gap_is_left_out_without_a_warning(
    lab: Path, gap_mm: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("zero.csv").write_text("\n".join([*ROWS[:2], f"{gap_mm},424,1.6,5500", *ROWS[2:]]))
    assert told(capsys, "zero.csv", "--model", "lab.toml") == (0, "")
    output = run_recipe(Recipe(name="zero", data=("zero.csv",), model="lab.toml"))
    assert output.data.used.tolist() == [True, False, *[True] * 6]


@pytest.mark.parametrize("column", ["thrust_N", "thrust_ratio"])
def test_more_points_than_memory_allows_are_refused(
    lab: Path, column: str, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "0.1,5000,1.1\n" * 10_001
    Path("many.csv").write_text(f"plate_z_m,rpm1,{column}\n{rows}")
    basis = ["--basis", "equal_rpm2"] if column == "thrust_ratio" else []
    code, err = told(capsys, "many.csv", "--model", "single", "--rig", "pquad_single", *basis)
    assert code == 2
    assert "10,001 points" in err


@pytest.mark.parametrize("column", [0, 1, 2, 3])
def test_a_row_with_an_empty_cell_is_left_out_and_counted(lab: Path, column: int) -> None:
    cells = ROWS[3].split(",")
    cells[column] = ""
    Path("gap.csv").write_text("\n".join([*ROWS[:3], ",".join(cells), *ROWS[4:]]), "utf-8")
    output = run_recipe(Recipe(name="gap", data=("gap.csv",), model="lab.toml"))
    assert output.data.used.tolist() == [True, True, False, True, True, True, True]
    assert "1 of 7 points have an empty cell" in output.data.left_out[0]
    assert "data row 3" in output.data.left_out[0]
    whole = run_recipe(Recipe(name="lab", data=("lab.csv",), model="lab.toml")).results[0]
    assert output.results[0]["R_m"].value == pytest.approx(whole["R_m"].value, abs=0.002)


def test_distances_in_the_wrong_unit_are_noticed(lab: Path) -> None:
    Path("m.toml").write_text(MODEL.replace('unit = "mm"', 'unit = "m"'), "utf-8")
    output = run_recipe(Recipe(name="lab", data=("lab.csv",), model="m.toml"))
    assert any("with benchtool motor" in item for item in output.results[0].warnings)


def test_a_loss_that_emcee_does_not_know_is_named(lab: Path) -> None:
    given = {"walkers": 8, "max_steps": 100, "loss": "huber"}
    output = run_recipe(
        Recipe(name="lab", data=("lab.csv",), model="lab.toml", methods=("emcee",), **given)
    )
    note = "emcee counts every point in full: --loss huber acts on least squares alone"
    assert note in output.results[0].warnings


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "nothing to fit: give run folders"),
        (("lab.csv",), "does not say how large the rotor is; give --radius"),
        (("lab.csv", "--model", "lab.tom"), "there is no such file|unknown model"),
        (("lab.csv", "--model", "lab.toml", "--seed", "-1"), "--seed"),
        (
            ("lab.csv", "--model", "lab.toml", "--method", "bogus"),
            "unknown --method 'bogus'",
        ),
        (("lab.csv", "--model", "lab.toml", "--walkers", "1"), "--walkers is 1"),
        (("lab.csv", "--model", "lab.toml", "--max-steps", "5"), "--max-steps is 5"),
        (("lab.csv", "--model", "lab.toml", "--basis", "x"), "unknown --basis 'x'"),
        (("lab.csv", "--model", "lab.toml", "--basis", "equal_pwm"), "kind 'reference'"),
        (("lab.csv", "--model", "lab.toml", "--free", "K_b"), "unknown parameter 'K_b'"),
        (("lab.csv", "--model", "lab.toml", "--fix", "k=x"), "--fix got 'k=x'; write NAME=NUMBER"),
        (
            ("lab.csv", "--model", "lab.toml", "--compare", "lws"),
            "did you mean 'laws'. known: .*laws",
        ),
        (
            (str(QUAD), "--model", "quad", "--where", "a=1", "--columns", "c.toml"),
            "--columns and --where can be given for a CSV table only: .* is a run",
        ),
        (
            ("lab.csv", "--model", "lab.toml", "--profile", "--loss", "huber"),
            "--profile is of least squares with --loss linear; leave --profile out",
        ),
        (
            ("lab.csv", "--model", "lab.toml", "--profile", "--method", "emcee"),
            "--profile is of least squares with --loss linear; leave --profile out",
        ),
        (("lab.csv", "lab.csv", "--model", "lab.toml"), "the same data as lab.csv"),
        ((str(QUAD.parent), "--model", "quad"), "neither a file nor a run folder"),
        (("lab.csv", "--model", "lab.toml", "--min-z-over-r", "99"), "none of 7 points"),
        (("lab.csv", "--model", "lab.toml", "--out", "."), "exists already"),
    ],
)
def test_what_cannot_be_used_is_said_with_exit_code_2(
    lab: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], said: str
) -> None:
    import re

    code, text = told(capsys, *words)
    assert code == 2, text
    assert re.search(said, text), text
    assert "\n" not in text


def test_a_channel_that_nothing_reads_is_refused(
    lab: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("typo.toml").write_text(MODEL.replace("plate_z_m =", "plat_z_m ="), "utf-8")
    code, text = told(capsys, "lab.csv", "--model", "typo.toml")
    assert code == 2
    assert "unknown channel 'plat_z_m'; did you mean 'plate_z_m'?" in text


def test_a_column_that_stands_twice_is_refused(
    lab: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [f"{row},{row.split(',')[1]}" for row in ROWS]
    Path("twice.csv").write_text("\n".join(rows), "utf-8")
    code, text = told(capsys, "twice.csv", "--model", "lab.toml")
    assert code == 2
    assert "column 'F_gf' stands 2 times" in text


def test_one_point_gives_no_answer_to_use(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("one.csv").write_text("\n".join(ROWS[:2]), "utf-8")
    with pytest.raises(SystemExit):
        main(["fit", "one.csv", "--model", "lab.toml", "--out", "one"])
    assert "No answer to use from 1 of 1 points" in capsys.readouterr().out
    output = run_recipe(Recipe(name="one", data=("one.csv",), model="lab.toml"))
    assert output.results[0].outcome.status != "converged"
    assert not np.isfinite(output.results[0].covariance).all()
