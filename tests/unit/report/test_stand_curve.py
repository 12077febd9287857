"""Thrust against speed alone, as a stand measures it: the curve is drawn and a missed one told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchtool.fit.recipe import Recipe
from benchtool.fit.run_recipe import FitOutput, run_recipe
from benchtool.report.figure import drawn

RPM = np.linspace(3000.0, 9000.0, 12)
SPEED = RPM * np.pi / 30.0


def fitted(folder: Path, excess: float, **more: object) -> FitOutput:
    """Fit k to points whose thrust rises by `excess` more than with the square of speed."""
    noise = 1.0 + 0.002 * np.random.default_rng(3).standard_normal(12)
    thrust = 1e-5 * SPEED**2 * (SPEED / 600.0) ** excess * noise
    rows = [f"{rpm:.1f},{newton:.5f}" for rpm, newton in zip(RPM, thrust, strict=True)]
    table = folder / "stand.csv"
    table.write_text("\n".join(["rpm1,thrust_N", *rows]))
    recipe = Recipe(
        name="stand",
        data=(str(table),),
        model="single",
        rig="pquad_single",
        hold=("R_m",),
        **more,  # type: ignore[arg-type]
    )
    return run_recipe(recipe)


def test_the_fitted_curve_is_drawn_through_the_points(tmp_path: Path) -> None:
    output = fitted(tmp_path, 0.0)
    upper = drawn("fit", output, ["thrust"])["thrust"].figure.axes[0]
    (line,) = [each for each in upper.lines if len(each.get_xdata()) > len(RPM)]
    rpm, thrust = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
    assert rpm[0] == 0.0
    assert rpm[-1] > RPM[-1]
    k = output.results[0]["k"].value
    assert thrust == pytest.approx(k * (rpm * np.pi / 30.0) ** 2)
