"""Public functions of `import benchtool as bt` and their results."""

from __future__ import annotations

import doctest
import inspect
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import benchtool as bt
from benchtool.core.errors import DataWarning, InputError, UnknownChoice, WouldOverwrite
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
    assert inspect.signature(bt.fit).parameters["walkers"].default == 32
    assert "check" in inspect.signature(bt.explain).parameters
    assert "Rotor radius: 0.1016 or 4in. [above 0, at most 100 m]" in (bt.fit.__doc__ or "")
    assert "fit(data=(), model=None, *, rpm='', runs='', permit=check_" in (bt.fit.__doc__ or "")


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


COLUMNS = {"z": "rise", "z_unit": "mm", "thrust": "F", "unit": "gf", "radius": 0.127}


@pytest.fixture
def heights():
    """Thrust over height of one rotor, R_m 0.105 m."""
    z_m = np.array([0.08, 0.1, 0.13, 0.2, 0.4, 0.8])
    thrust_N = 4.0 / (1.0 - (0.105 / (4.0 * z_m)) ** 2) * (1.0 + 1e-3 * np.array([1, -1] * 3))
    return pd.DataFrame({"rise": 1e3 * z_m, "F": thrust_N / 9.80665e-3, "rpm": 6000})


def test_a_frame_is_fitted_like_its_file(heights, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    heights.to_csv("heights.csv", index=False)
    expected = bt.fit("heights.csv", **COLUMNS).params["R_m"]
    mapping = {name: heights[name].to_numpy() for name in heights}
    for table in (heights, heights.set_index("rise"), mapping):
        assert bt.fit(table, "single", **COLUMNS).params["R_m"] == expected
    heights.attrs["units"] = {"rise": "mm", "F": "gf", "rpm": "rpm"}
    fit = bt.fit(heights, z="rise", thrust="F", radius="5 inch")
    assert fit.params["R_m"] == expected
    assert [path.name for path in tmp_path.iterdir()] == ["heights.csv"]
    heights.attrs["units"]["F"] = "kgf"
    with pytest.warns(DataWarning, match="k is .* check the units") as warned:
        wrong = bt.fit(heights, z="rise", thrust="F", radius="127mm")
    assert [warning.filename for warning in warned] == [__file__]
    assert wrong.params["R_m"].value == pytest.approx(expected.value, rel=1e-6)
    note = "unit='gf' contradicts the unit in 'F_kg'; gf is used"
    with pytest.warns(DataWarning, match="6000 rpm is"), pytest.warns(DataWarning, match=note):
        bt.fit(heights.drop(columns="rpm").rename(columns={"F": "F_kg"}), **COLUMNS)


@pytest.mark.parametrize(
    ("change", "options", "message"),
    [
        ({}, {"radius": None}, r"^table.csv: the rotor radius is missing; add radius=RADIUS, as"),
        ({"motor": list("aaabbb")}, {}, "2 run names .* add runs='none' for one"),
        ({"motor": list("aaabbb")}, {"runs": "motor"}, "2 fits; .* with where='motor=a'"),
        ({}, {"thrst": "F"}, "unknown input 'thrst'; did you mean 'thrust'"),
        ({}, {"rig": "pquad"}, "radius and rig are both given"),
    ],
)
def test_a_table_that_lacks_something_is_an_error_in_keywords(heights, change, options, message):
    with pytest.raises(InputError, match=message):
        bt.fit(heights.assign(**change), **COLUMNS | options)


def test_data_of_another_type_are_refused():
    with pytest.raises(InputError, match="data are int; give paths, results of"):
        bt.fit(5)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="not arrays of one length"):
        bt.read({"time_s": [1.0], "thrust_N": [1.0, 2.0]})
    wrong = pd.DataFrame({"thrust_N": [1.0]})
    wrong.attrs["units"] = {"thrust_N": "gf"}
    with pytest.raises(InputError, match="'gf' for thrust_N, which is in N"):
        bt.read(wrong)


def test_numbers_of_a_fit_come_in_one_step(fitted):
    row = fitted.to_dataframe().set_index("parameter").loc["body_lift.K_b"]
    param = fitted.params["K_b"]
    assert (param.value, param.se) == (row["value"], row["combined_sd"])
    assert param.interval() == (row["combined_low_95"], row["combined_high_95"])
    _, high = param.interval(0.6827)
    assert 0.9 * param.se < high - param.value < 1.2 * param.se
    assert "R_m" in fitted.params
    assert "R" not in fitted.params
    assert list(fitted.params)[: len(fitted.covariance)] == list(fitted.covariance)
    with pytest.raises(UnknownChoice, match="unknown parameter 'R'; known: R_m"):
        fitted.params["R"]
    residuals = fitted.residuals
    points = fitted.to_dataframe("points").loc[residuals.index]
    assert residuals["observed"].to_numpy() == pytest.approx(points["thrust_N"].to_numpy())
    assert fitted.predict([1.0, 4.0])[0] > fitted.predict(4.0) > 1.0
    assert fitted.predict(1.0) < fitted.band(1.0, 0.68)[1] < fitted.band([1.0, 4.0])[1][0]
    assert repr(param).startswith("body_lift.K_b = 1.9")
    assert "K_b, R_over_rotor_radius: most of ± is plate_offset.dz_m" in repr(fitted)
    assert "body_lift.K_b" in fitted.params._repr_html_()
    for wrong in (lambda: param.interval(95), lambda: fitted.samples, lambda: fitted.predict(-1)):
        with pytest.raises(InputError, match=r"level is 95|method='emcee'|z_over_R is -1"):
            wrong()
    for value in (fitted, fitted.model, fitted.model.rig, fitted.found):
        assert len(repr(value).splitlines()) <= 6


def test_draws_have_the_shape_of_the_chains(heights):
    fit = bt.fit(heights, **COLUMNS, method="emcee", fix={"k": 1.0132e-5}, noise="stated")
    shape = (-1, fit.samples.attrs["ensembles"] * fit.samples.attrs["walkers"])
    assert fit.samples["R_m"].to_numpy().reshape(shape).shape[0] > 1
    assert fit.samples["R_m"].median() == pytest.approx(fit.params["R_m"].value, rel=0.05)


@pytest.mark.slow
def test_examples_of_docstrings_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("BENCHTOOL_STATE", str(tmp_path / "state"))
    runner, parser = doctest.DocTestRunner(), doctest.DocTestParser()
    names = [name for name in bt.__all__ if "Examples\n" in (getattr(bt, name).__doc__ or "")]
    assert len(names) == 15
    for name in sorted(names, key=lambda name: name != "sweep"):  # others read its run
        runner.run(parser.get_doctest(getattr(bt, name).__doc__, {}, name, None, None))
    assert runner.summarize().failed == 0, capsys.readouterr().out


def test_mypy_knows_the_keywords(tmp_path):
    (tmp_path / "script.py").write_text(
        "import benchtool as bt\n"
        'bt.sweep("sim:pquad", z_over_r=(1, 2), pwm=1500, yes=True, progress=True)\n'
        'bt.motor("run"), bt.compare("run"), bt.export("quad", "c"), bt.runs(rig="a"), bt.fly\n'
        'bt.fit({"F": [1.0]}, radius=0.1, method="emcee").params["R_m"]\n'
        "bt.fit({}, raduis=0.1)\n"
    )
    stub = Path(bt.__file__).with_suffix(".pyi")
    options = ["--strict", "--follow-imports=skip", f"--cache-dir={tmp_path / 'cache'}"]
    output = subprocess.run(
        [sys.executable, "-m", "mypy", *options, tmp_path / "script.py", stub],
        capture_output=True, text=True, check=False, cwd=stub.parents[1],
    ).stdout  # fmt: skip
    errors = [line for line in output.splitlines() if "script.py" in line and "error" in line]
    assert len(errors) == 1, output
    assert 'script.py:5: error: Unexpected keyword argument "raduis" for "fit"' in errors[0]


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
    away = bt.simulate_pitch("pid", schedule="steps", duration_s=1.0)
    assert away.tables == ("pid",)
    labels = [line.get_label() for line in away.plot().axes[0].lines]
    assert labels == ["reference", "pitch"]
    flight = bt.simulate_flight("pid", duration_s=1.0)
    assert flight.tables == ("oge", "PID")
    assert np.isfinite(flight.to_dataframe()["x_m"]).all()
    for result in (study, flight):
        text = result.report(tmp_path / f"{result.tables[-1]}.html").read_text("utf-8")
        assert "SIMULATED" in text
    for wrong in (["pid", "pid"], [], [Still()], Still()):
        with pytest.raises(InputError, match=r"name each once|give its class"):
            bt.simulate_pitch(wrong)
    for data, message in ((study, "several recordings"), (bt.simulate_pitch("pid"), "same data")):
        with pytest.raises(InputError, match=message):
            bt.explain(data, data, "quad")


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
    page, *others = fitted.save(tmp_path / "fit")
    assert page.name == "report.html"
    assert {page, *others} == {path for path in (tmp_path / "fit").rglob("*") if path.is_file()}
    assert bt.load_model(tmp_path / "fit" / "model.toml").name
    with pytest.raises(WouldOverwrite):
        fitted.save(tmp_path / "fit")
