"""Measured data from elsewhere, fitted from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchtool.commands.app import main
from benchtool.core.errors import InputError
from benchtool.fit.recipe import Recipe
from benchtool.fit.run_recipe import run_recipe

DATASETS = Path(__file__).parents[3] / "datasets"


def test_the_one_parameter_law_is_rejected_for_the_rotor_pair(
    reference_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Source of the numbers: an independent fit gave c = (R_eff/R)^2 = 1.13, T0 = 20.41 N."""
    words = [
        *("fit", str(reference_data / "ground_effect/rotor_pairs.csv")),
        *("--model", str(DATASETS / "rotor_pair/model.toml")),
        *("--where", "series=Fz0", "--method", "least_squares", "--method", "emcee"),
        *("--out", str(tmp_path / "fit")),
    ]
    with pytest.raises(SystemExit) as left:
        main(words)
    assert left.value.code == 9
    assert "is rejected" in capsys.readouterr().out
    result = json.loads((tmp_path / "fit/result.json").read_text("utf-8"))
    least = result["results"]["least_squares"]
    assert least["chi2_per_dof"] == pytest.approx(35.0, abs=1.0)
    assert least["derived"]["R_over_rotor_radius"]["value"] ** 2 == pytest.approx(1.13, abs=0.01)
    speed = 6300.0 * 3.141592653589793 / 30.0
    assert least["estimates"]["k"]["value"] * speed**2 == pytest.approx(20.41, abs=0.01)
    sampled = result["results"]["emcee"]
    assert sampled["outcome"]["status"] == "converged"
    for name, item in least["estimates"].items():
        other = sampled["estimates"][name]
        assert other["value"] == pytest.approx(item["value"], abs=0.1 * item["sd"])
        assert other["sd"] == pytest.approx(item["sd"], rel=0.1)
    assert result["simulated"] is False
    assert {"ratio.svg", "report.html", "model.toml", "samples.csv"} <= {
        path.name for path in (tmp_path / "fit").iterdir()
    }


def test_a_stands_log_gives_its_thrust_law(reference_data: Path) -> None:
    output = run_recipe(
        Recipe(
            name="a1",
            data=(str(reference_data / "rcbenchmark_1520/a1_11.csv"),),
            model=str(DATASETS / "thrust_stand/model.toml"),
        )
    )
    result = output.results[0]
    assert result.outcome.status == "converged"
    # The row at 14211 rpm, close to the reference of 1500 rad/s, reads 253.954 gf.
    assert result["k"].value == pytest.approx(253.954e-3 * 9.80665 / 1488.17**2, rel=0.02)
    largest = output.data.observed.max()
    assert abs(output.problem.observed - output.problem.predicted(result.values[[0, 2]])).max() < (
        0.03 * largest
    )


def test_a_dead_speed_column_is_refused(reference_data: Path, tmp_path: Path) -> None:
    text = (DATASETS / "thrust_stand/model.toml").read_text("utf-8")
    model = tmp_path / "optical.toml"
    model.write_text(text.replace("Motor Electrical", "Motor Optical"), "utf-8")
    with pytest.raises(InputError, match="no rotor turns in 11 points while thrust reaches"):
        run_recipe(
            Recipe(
                name="a1",
                data=(str(reference_data / "rcbenchmark_1520/a1_11.csv"),),
                model=str(model),
            )
        )
