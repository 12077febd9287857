"""`benchtool plan`: what it says, and that the command it prints works."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from tests.unit.commands.command_line import run

RUN = Path(__file__).parents[3] / "datasets" / "quad" / "run"
NEAR = """plate_z_m,rpm1,thrust_N,thrust_se_N
0.07,5500,4.1,0.02
0.12,5500,3.7,0.02
0.18,5500,3.5,0.02
0.24,5500,3.45,0.02
0.36,5500,3.42,0.02
0.60,5500,3.4,0.02
"""


def planned(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    assert run("plan", *words) == 0
    return capsys.readouterr().out


def test_the_printed_sweep_of_a_run_works(capsys: pytest.CaptureFixture[str]) -> None:
    out = planned(capsys, RUN, "--model", "quad_body_lift", "--hold", "R_m", "--for", "k=0.02%")
    assert "k: standard uncertainty" in out
    assert "visit every setting" in out
    *_, command = (line.strip() for line in out.splitlines() if "benchtool sweep" in line)
    words = shlex.split(command)[1:]
    assert run(*words, "--dry-run") == 0
    assert "repeats" in capsys.readouterr().out


def test_a_step_that_increases_the_uncertainty_is_explained(
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = planned(capsys, RUN, "--model", "quad_bench", "--for", "k=0.005%")
    assert "no: it increases" in out
    assert "leans more on what it holds fixed (* in the budget of benchtool fit)" in out


def test_a_table_gets_a_dry_run_of_its_rig(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "near.csv").write_text(NEAR)
    words = ["--model", "single", "--rig", "pquad_single", "--for", "R=1%"]
    out = planned(capsys, tmp_path / "near.csv", *words)
    *_, command = (line.strip() for line in out.splitlines() if "benchtool sweep" in line)
    assert command.startswith("benchtool sweep sim:pquad_single --dry-run --z-over-r ")
    assert run(*shlex.split(command)[1:]) == 0


def test_what_is_reached_needs_no_sweep(capsys: pytest.CaptureFixture[str]) -> None:
    out = planned(capsys, RUN, "--model", "quad_bench", "--for", "R=90%")
    assert out.splitlines()[-1] == "the target is reached: no further measurement is needed"


@pytest.mark.parametrize(
    ("goal", "said"),
    [
        ("", "no target uncertainty is given; give one, for example --for R=0.5%"),
        ("R=0", "a quantity and a number above 0 are needed"),
        ("R=1.2.3%", "a quantity and a number above 0 are needed"),
        ("Q=1%", "unknown quantity 'Q'; known: R_m, R_over_rotor_radius, body_lift.K_b, k"),
    ],
)
def test_what_cannot_be_planned_is_refused(
    goal: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("plan", RUN, "--model", "quad_body_lift", "--for", goal) == 2
    assert said in capsys.readouterr().err
