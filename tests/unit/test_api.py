"""Public functions of `import benchtool as bt` and their results."""

from __future__ import annotations

import inspect
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import benchtool as bt
from benchtool.core.errors import InputError, UnknownChoice, WouldOverwrite
from benchtool.data.run.read import read_points
from benchtool.fit.recipe import Recipe
from benchtool.fit.run_recipe import run_recipe

RUN = Path(__file__).parents[2] / "datasets" / "quad" / "run"


@pytest.fixture(scope="module")
def fitted():
    return bt.fit(RUN, "quad_body_lift", fix={"k": 1.0208e-5})


def test_the_package_imports_lazily():
    code = "import sys, benchtool as bt; dir(bt); print([m for m in sys.modules if '.' in m and m.startswith('benchtool')])"  # fmt: skip # noqa: E501
    output = subprocess.check_output([sys.executable, "-c", code], text=True)
    assert output.strip() == "[]"
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        bt.nothing  # type: ignore[attr-defined]  # noqa: B018


def test_every_public_name_exists_after_submodule_imports():
    import benchtool.explain.engine.explain
    import benchtool.fit.problem

    for name in benchtool.__all__:
        assert getattr(bt, name) is not None
    assert "model" in inspect.signature(bt.fit).parameters
    assert "check" in inspect.signature(bt.explain).parameters


def test_a_run_has_summary_tables_and_plots():
    run = bt.read(RUN)
    assert run.summary().startswith("80 points of 16 settings on rig pquad")
    points = run.to_dataframe()
    assert points["thrust_N"].to_numpy() == pytest.approx(read_points(RUN).column("thrust_N"))
    assert points.attrs["units"]["thrust_N"] == "N"
    assert set(points["kind"]) == {"measure", "reference", "anchor"}
    assert run.tables[:2] == ("points", "settings")
    assert run.plot("distance").axes
    png = run.plot("distance")._repr_png_()  # type: ignore[attr-defined]
    assert png.startswith(b"\x89PNG")
    html = run._repr_html_()
    assert html.startswith("<div><pre")
    assert "<svg" in html
    with pytest.raises(UnknownChoice, match="unknown table 'point'; did you mean 'points'"):
        run.to_dataframe("point")


def test_a_test_stand_log_is_read_like_import(tmp_path):
    log = tmp_path / "stand.csv"
    log.write_text(
        "Time (s),ESC signal (µs),Thrust (kgf),Motor Electrical Speed (RPM)\n"
        + "".join(f"{0.1 * row},{1000 + 10 * row},{0.01 * row},{100 * row}\n" for row in range(20))
    )
    samples = bt.read(log).to_dataframe("samples")
    assert samples["thrust_N"].iloc[-1] == pytest.approx(0.19 * 9.80665)
    other = tmp_path / "other.csv"
    other.write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="column"):
        bt.read(other)


def test_a_fit_equals_that_of_the_command(fitted):
    recipe = Recipe(name="run", data=(str(RUN),), model="quad_body_lift", fix={"k": 1.0208e-5})
    expected = run_recipe(recipe).results[0]
    table = fitted.to_dataframe("estimates").set_index("parameter")
    for item in expected.estimates:
        assert table.loc[item.name, "value"] == item.value
        assert tuple(table.loc[item.name, ["low_95", "high_95"]]) == item.interval_95
    assert fitted.found.fitted.parameters["body_lift.K_b"].value == pytest.approx(1.9, abs=0.1)
    assert repr(fitted) == fitted.summary()


def test_a_fit_takes_a_read_run_and_writes_its_report(fitted, tmp_path):
    again = bt.fit([bt.read(RUN)], "quad_body_lift", fix={"k": 1.0208e-5})
    assert again.summary() == fitted.summary()
    page = fitted.report(tmp_path / "fit.html")
    assert "K_b" in page.read_text("utf-8")
    with pytest.raises(InputError, match="exists already"):
        fitted.report(page)
    assert {"ratio", "residuals"} <= set(fitted.figures())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"basi": "joint"}, "unknown input 'basi'; did you mean 'basis'"),
        ({"basis": "equal"}, "unknown basis 'equal'"),
        ({"walkers": 4}, "walkers is 4, allowed is 8 or more"),
    ],
)
def test_an_invalid_option_is_reported_by_name(options, message):
    with pytest.raises(InputError, match=message):
        bt.fit(RUN, "quad_body_lift", **options)


def test_simulations_take_a_user_controller(tmp_path):
    class Still:
        def step(self, measurement: object, reference: object, dt_s: float) -> float:
            return 0.0

    study = bt.simulate_pitch(["pid", Still], seed=3, duration_s=1.0)
    assert study.tables == ("pid", "Still", "visits")
    assert len(study.to_dataframe("Still")) == 250
    assert study.summary().startswith("SIMULATED pitch bench pquad")
    flight = bt.simulate_flight("pid", duration_s=1.0)
    assert flight.tables == ("oge", "PID")
    assert np.isfinite(flight.to_dataframe()["x_m"]).all()
    for result in (study, flight):
        text = result.report(tmp_path / f"{result.tables[-1]}.html").read_text("utf-8")
        assert "SIMULATED" in text
    for wrong in (["pid", "pid"], []):
        with pytest.raises(InputError, match="name each once"):
            bt.simulate_pitch(wrong)


def test_an_explanation_has_verdict_and_tables(tmp_path):
    from tests.unit.explain.test_sweep_subject import lab_sweep

    for seed in (1, 2):
        lab_sweep(tmp_path / f"{seed}.csv", seed, (0.6, 0.8, 1.0, 1.3, 1.8, 2.5, 3.5, 6.0))
    result = bt.explain(
        tmp_path / "1.csv", tmp_path / "2.csv", "single", rig="pquad_single", draws=20
    )
    assert "a different law of thrust against distance" in result.summary()
    assert result.to_dataframe("probabilities")["probability"].is_monotonic_decreasing
    assert set(result.to_dataframe("gap")["channel"]) == {"thrust_N", "rpm"}
    assert result.tables == ("effects", "gap", "probabilities")


def test_a_fit_is_saved_like_the_command(fitted, tmp_path):
    (page,) = fitted.save(tmp_path / "fit")
    assert page.name == "report.html"
    assert bt.load_model(tmp_path / "fit" / "model.toml").name
    with pytest.raises(WouldOverwrite):
        fitted.save(tmp_path / "fit")
