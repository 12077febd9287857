"""What a table states of its thrusts' errors, and what a fit says where they determine nothing."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchtool.core.rig_file import load_rig_by_name
from benchtool.data.run.ratios import thrust_error
from benchtool.data.table import read_table
from benchtool.explain.sweep.log import sweep_log
from benchtool.fit.recipe import Recipe
from benchtool.fit.result_file import read_fit
from benchtool.fit.run_recipe import FitOutput, run_recipe
from benchtool.report.fit.page import terminal_blocks, write_fit


def table(folder: Path, columns: str, *errors: str) -> str:
    """Write six points of one rotor far from the plate with these columns of errors."""
    rows = [
        f"{rpm},{z_m},{1e-5 * (rpm * np.pi / 30.0) ** 2:.5f},{error}"
        for rpm, z_m, error in zip(range(4000, 7000, 500), [0.9, 1.1] * 3, errors, strict=True)
    ]
    (folder / "table.csv").write_text("\n".join([f"rpm1,plate_z_m,thrust_N,{columns}", *rows]))
    return str(folder / "table.csv")


def fitted(data: str, **more: object) -> FitOutput:
    recipe = {"model": "single", "rig": "pquad_single", **more}
    return run_recipe(Recipe(name="one", data=(data,), **recipe))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("columns", "errors", "expected", "of_samples"),
    [
        ("thrust_se_N", ["0.02"] * 6, 0.02, False),
        ("thrust_sd_N", ["0.02"] * 6, 0.02, False),
        ("thrust_sd_N,n_samples", ["0.12,36"] * 6, 0.02, True),
        # One row states both: its samples go together by four, and so do the others'.
        ("thrust_sd_N,n_samples,thrust_se_N", ["0.12,36,0.04"] + ["0.12,36,"] * 5, 0.04, True),
    ],
)
def test_a_scatter_of_samples_is_not_the_error_of_their_mean(
    tmp_path, columns, errors, expected, of_samples
):
    data = table(tmp_path, columns, *errors)
    points = read_table(data)
    found = thrust_error(points)
    assert found is not None
    np.testing.assert_allclose(found[0], expected)
    assert found[1] == of_samples
    output = fitted(data, hold=("R_m",))
    np.testing.assert_allclose(output.data.standard_error, expected)
    # Samples within a visit know nothing of what differs between visits, as in a run.
    assert ("noise.scale" in output.problem.free_names) == of_samples
    log = sweep_log(points, load_rig_by_name("pquad_single"))
    np.testing.assert_allclose(log.se_N, expected)


def test_what_data_do_not_determine_is_said_with_why(tmp_path):
    output = fitted(table(tmp_path, "thrust_se_N", *["0.02"] * 6))
    found = output.results[0]["R_m"]
    assert found.sd > 1.0  # metres, of a rotor of 0.12 m
    why = "not determined: its 95 % interval is all that its bounds allow, 0.012 to 0.36"
    assert why in write_fit(tmp_path / "fit", output).read_text("utf-8")
    # The numbers stay where programs read them.
    stated = json.loads((tmp_path / "fit" / "result.json").read_text("utf-8"))
    numbers = stated["results"]["least_squares"]["estimates"]["R_m"]
    assert numbers["value"] == found.value
    assert numbers["sd"] == found.sd
    assert numbers["interval_95"] == list(found.interval_95)
    assert terminal_blocks(read_fit(tmp_path / "fit")) == terminal_blocks(output)
