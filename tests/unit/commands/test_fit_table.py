"""Command `benchtool fit` with the columns of a CSV table."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest

from tests.unit.commands.command_line import said
from tests.unit.commands.test_rig_new import Terminal

RADIUS_M = 0.127
T_OGE_N = 3.2
Z_M = RADIUS_M * np.array([0.6, 0.8, 1.0, 1.5, 2.0, 3.0, 4.0])
RATIO = 1.0 / (1.0 - (RADIUS_M / 4.0 / Z_M) ** 2)  # Cheeseman and Bennett, by hand
SCATTER = 1.0 + 0.001 * np.array([1.0, -1.0, 0.5, 0.3, -0.7, 0.2, -0.4])
GF_PER_N = 1e3 / 9.80665

Capsys = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    return tmp_path


def table(name: str, head: str, *columns: np.ndarray | list[str], delimiter: str = ",") -> None:
    def cell(value: object) -> str:
        text = value if isinstance(value, str) else f"{value:.6g}"
        return text.replace(".", ",") if delimiter == ";" else text

    rows = [delimiter.join(map(cell, row)) for row in zip(*columns, strict=True)]
    Path(name).write_text("\n".join([head, *rows, ""]), "utf-8")


def spreadsheet() -> None:
    thrust = T_OGE_N * RATIO * SCATTER * GF_PER_N
    table("data.csv", "Messung 3;;\n\nAbstand;Schub;Notiz", Z_M, thrust, ["gut"] * 7, delimiter=";")


def result(folder: str) -> dict[str, dict[str, float]]:
    stored = json.loads(Path(folder, "result.json").read_text())
    estimates: dict[str, dict[str, float]] = stored["results"]["least_squares"]["estimates"]
    return estimates


def fit(capsys: Capsys, arguments: str) -> tuple[int, str, str]:
    return said(capsys, "fit", *arguments.split())


def test_a_spreadsheet_is_fitted_with_column_options_and_radius(capsys):
    spreadsheet()
    arguments = "data.csv --z Abstand --thrust Schub --unit gf --radius 0.127 --out first"
    code, out, error = fit(capsys, arguments)
    assert code == 0, error
    estimates = result("first")
    assert estimates["R_m"]["value"] == pytest.approx(RADIUS_M, rel=0.01)
    thrust = estimates["k"]["value"] * (6000.0 * np.pi / 30.0) ** 2
    assert thrust == pytest.approx(T_OGE_N, rel=2e-3)
    # The printed command and the fitted model use the written files.
    line = next(line for line in out.splitlines() if line.startswith("repeat with: benchtool fit "))
    arguments = line.removeprefix("repeat with: benchtool fit data.csv ")
    assert arguments == "--map data.columns.toml --rig data.rig.toml --model single"
    for options in (arguments, "--model first/model.toml"):
        code, out, error = fit(capsys, f"data.csv {options}")
        assert (code, "  R_m  " in out, " 0.127" in out) == (0, True, True), error
    before = Path("data.columns.toml").read_text()
    code, out, _ = fit(capsys, "data.csv --unit N --radius 0.127")
    assert "written: data.columns-2.toml" in out
    assert Path("data.columns.toml").read_text() == before
    code, _, error = fit(capsys, "data.csv --unit N --radius 0.52")
    lie_below = "5 of 7 points lie below z/R = 0.5: distances 0.076 to 0.51 m, rotor radius 0.52 m"
    assert (code, lie_below in error) == (6, True), error


def test_ratios_give_a_radius_and_no_thrust_coefficient(capsys):
    table("r.csv", "z [mm],T_ratio", 1e3 * Z_M, RATIO * SCATTER)
    code, _, error = fit(capsys, "r.csv --ratio T_ratio --radius 0.127 --out r")
    assert code == 0, error
    estimates = result("r")
    assert set(estimates) == {"R_m", "noise.scale"}
    assert estimates["R_m"]["value"] == pytest.approx(RADIUS_M, rel=0.01)


def test_reference_rows_are_out_of_ground_effect(capsys):
    distances = [*map("{:.5f}".format, Z_M), "free"]
    thrusts = np.array([*(T_OGE_N * RATIO * SCATTER), T_OGE_N])
    table("a.csv", "gap (m),F (N),n (1/s)", distances, thrusts, np.full(8, 100.0))
    code, _, error = fit(capsys, "a.csv --radius 0.127")
    assert (code, "contains 'free' among its distances" in error) == (2, True), error
    code, out, error = fit(capsys, "a.csv --radius 0.127 --reference gap=free --out a")
    assert (code, "reference rows: gap (m) = free" in out) == (0, True), error
    assert result("a")["k"]["value"] == pytest.approx(T_OGE_N / (200.0 * np.pi) ** 2, rel=1e-3)


MISSING = {
    "z (m),F (N),rpm": ("", "rotor radius is missing; add --radius RADIUS, as 0.1016 or 4in"),
    "a,F (N),rpm": ("", "--radius RADIUS --z a\n"),
    "z (m),b,rpm": ("--radius 0.127", "--thrust b\n"),
    "my_Schub,plate,rpm": ("--radius 0.127", "--thrust my_Schub --z plate\n"),
    "height,total_thrust_N,rpm": ("--radius 1e-5", "--z-unit mm\n"),
    "z (m),F (V),rpm": ("--radius 0.127", "(columns: z (m), F (V), rpm); add --thrust COLUMN"),
    "z (m),F (N),F_std": ("--radius 0.127", "add --error-is SD_OR_SE"),
    "z (m),F (N),Standardabweichung [N]": ("--radius 0.127", "add --error-is SD_OR_SE"),
}


@pytest.mark.parametrize("head", MISSING)
@pytest.mark.parametrize("stdin", [io.StringIO, Terminal])
def test_missing_items_are_reported_and_no_file_is_written(capsys, monkeypatch, head, stdin):
    monkeypatch.setattr("sys.stdin", stdin(""))
    options, message = MISSING[head]
    table("a.csv", head, Z_M, T_OGE_N * RATIO, np.full(7, 6000.0))
    code, _, error = fit(capsys, f"a.csv {options}")
    assert (code, message in error) == (2, True), error
    assert sorted(path.name for path in Path().iterdir()) == ["a.csv"]


def test_every_bad_column_is_reported_at_once(capsys):
    table("a.csv", "dist,F", ["far", "x", "0.2"], ["1", "#N/A", "y"])
    code, _, error = fit(capsys, "a.csv")
    for message in ("rotor radius is missing", "'far' among its distances", "'F' contains 'y'"):
        assert (code, message in error) == (2, True), error


def test_usual_names_and_empty_cells_of_a_spreadsheet_are_read(capsys):
    cells = [*map("{:.5f}".format, RATIO), "#N/A"]
    table("a.csv", "height,T/T0", [*map("{:.5f}".format, Z_M), "#N/A"], cells)
    code, out, error = fit(capsys, "a.csv --radius 0.127 --out a")
    assert code == 0, error
    assert result("a")["R_m"]["value"] == pytest.approx(RADIUS_M, rel=0.01)
    assert len(out.splitlines()) <= 24
    assert "Uncertainty budget" not in out
    assert "Uncertainty budget" in fit(capsys, "a.csv --radius 0.127 --verbose")[1]


@pytest.mark.slow
def test_runs_of_one_file_are_fitted_separately(capsys):
    z, rpm = np.tile(Z_M, 2), np.full(14, 6000.0)
    thrust = np.concatenate([RATIO * SCATTER, 2.0 * RATIO * SCATTER])
    table("a.csv", "run,z (m),F (N),rpm", ["low"] * 7 + ["high"] * 7, z, thrust, rpm)
    code, _, error = fit(capsys, "a.csv --radius 0.127")
    assert (code, "contains 2 run names (low, high); add --runs run" in error) == (2, True), error
    code, out, error = fit(capsys, "a.csv --radius 0.127 --runs run --out each")
    assert (code, "Separate fits" in out) == (0, True), error
    low, high = (result(f"each/{name}")["k"]["value"] for name in ("low", "high"))
    assert high / low == pytest.approx(2.0, rel=1e-6)


@pytest.mark.slow
def test_published_tables_are_fitted_without_a_map(capsys, reference_data):
    data = reference_data
    pairs = f"{data}/ground_effect/rotor_pairs.csv --radius 0.1651 --error-is se"
    code, _, error = fit(capsys, f"{pairs} --where series=Fz0 --out pair")
    assert (code, "chi2/dof = 35" in error) == (9, True), error  # SOURCES.md: 35
    code, out, error = fit(capsys, f"{data}/crazyflie/eckart1.csv --radius 0.0231 --out no")
    assert (code, "no point has a plate distance" in out) == (6, True), error
    assert not Path("no/model.toml").exists()
    code, _, error = fit(capsys, f"{data}/crazyflie/eckart1.csv --radius 0.0231 --fix R_m --out cf")
    assert code == 0, error
    # SOURCES.md: kf 2.26e-8 g/rpm2 over the four rotors.
    k = 2.26e-8 * 9.80665e-3 / (np.pi / 30.0) ** 2
    assert result("cf")["k"]["value"] == pytest.approx(k, rel=5e-3)
    code, _, error = fit(capsys, f"{data}/uiuc/apcsf_10x7_static_kt0827.txt --fix R_m --out uiuc")
    assert code == 0, error
    # T = C_T rho n^2 D^4 at C_T 0.15, between its 0.141 and 0.161.
    k = 0.1575 * 1.225 * 0.254**4 / (2.0 * np.pi) ** 2
    assert result("uiuc")["k"]["value"] == pytest.approx(k, rel=0.03)


def test_thrust_of_the_wrong_sign_is_reported(capsys, reference_data):
    pusher = f"{reference_data}/rcbenchmark_1580/xNova-SR-steps-up.csv"
    code, _, error = fit(capsys, f"{pusher} --radius 0.0635 --out no")
    assert (code, "thrust_N is negative at 352 of 352 points" in error) == (6, True), error
    assert "--flip thrust_N" in error
    assert not Path("no").exists()


def test_thousands_separators_and_radii_are_parsed(capsys):
    lines = ["Abst;z/R;Schub [gf];rpm"]
    for z in (0.6, 0.8, 1.0, 1.5, 2.0, 4.0):
        thrust = f"{1200.0 / (1.0 - (0.25 / z) ** 2):.2f}".replace(".", ",")
        lines.append(
            f"7;{z:g};{thrust[:1]}.{thrust[1:]};6.000".replace("0.", "0,").replace("1.5", "1,5")
        )
    Path("a.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    code, out, _ = fit(capsys, "a.csv --z z/R --radius 0.127 --out fit")
    assert (code, "12 numbers with points between thousands" in out) == (0, True), out
    estimates = result("fit")
    assert estimates["R_m"]["value"] == pytest.approx(0.127, rel=1e-3)
    # k of thrust in N at 6,000 rpm, worked out by hand.
    assert estimates["k"]["value"] == pytest.approx(1.2 * 9.80665 / (200.0 * np.pi) ** 2, rel=1e-3)
