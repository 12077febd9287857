"""Reports of sweeps: the page holds the run's numbers, its hashes, and nothing from outside."""

from __future__ import annotations

import json
import math
import shutil

import pytest

from benchtool.core.errors import FileFormatError, InputError, WouldOverwrite
from benchtool.data.atomic import data_hash, file_hash
from benchtool.data.run.read import read_points
from benchtool.data.run.run import read_settings
from benchtool.explain.pitch.replay import ReplayInputs
from benchtool.report.numbers import value_with_sd
from benchtool.report.report_file import page_text, write_report
from benchtool.report.sweep.page import common_table
from benchtool.report.sweep.run import read_sweep_run
from tests.unit.commands.command_line import run as call
from tests.unit.report.report_text import check_self_contained, facts_of, rows_of, words_of

ASKED = ["--z-over-r", "0.6,1,2", "--repeats", "2", "--sample-s", "1", "--yes"]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Sweep one virtual rotor at two throttle levels."""
    path = tmp_path_factory.mktemp("reported") / "one"
    air = ["--temperature", "21", "--pressure", "1002", "--humidity", "45"]
    words = ["sim:pquad_single?seed=3", "--pwm", "1500,1600", *ASKED, *air, "--out", str(path)]
    assert call("sweep", *words) == 0
    return path


@pytest.fixture(scope="module")
def other(tmp_path_factory):
    """Sweep another virtual rotor at one of these levels."""
    path = tmp_path_factory.mktemp("reported") / "two"
    words = ["sim:pquad_single?truth=virtual_pquad_single&seed=5", "--pwm", "1500", *ASKED]
    assert call("sweep", *words, "--out", str(path)) == 0
    return path


@pytest.fixture(scope="module")
def page(run):
    return page_text([run], commands=["benchtool report one"])


def test_every_setting_stands_in_the_table_with_the_run_s_own_numbers(run, page):
    settings = read_settings(run)
    rows = rows_of(page, "Settings")
    assert len(rows) == len(settings) == 8
    for cells, thrust, rpm, kind in zip(
        rows,
        settings.column("thrust_N"),
        settings.column("rpm1"),
        settings.column("kind"),
        strict=True,
    ):
        assert float(cells[4].split(" ± ")[0]) == pytest.approx(thrust, abs=0.002)
        assert float(cells[3]) == pytest.approx(rpm, abs=0.5)
        assert (cells[0] == "parked") == (kind == 1.0)
    swept = read_sweep_run(run)
    near = [value_with_sd(*pair) for pair in zip(swept.ratio, swept.ratio_error, strict=True)]
    assert [cells[5] for cells in rows if cells[5] != "–"] == near[:6]


def test_an_error_bar_is_never_smaller_than_a_visit_s_own_error(run):
    swept, points = read_sweep_run(run), read_points(run)
    for place, number in enumerate(swept.settings.column("setting")):
        own = points.column("thrust_se_N")[points.column("setting") == number]
        assert swept.thrust_error_N[place] >= own.mean() * (1.0 - 1e-12)
        assert swept.thrust_error_N[place] >= swept.settings.column("thrust_sd_N")[place]


def test_hashes_are_those_of_the_files(run, page):
    facts = facts_of(page)
    assert facts["sha256 of the run's data (points and samples)"] == data_hash(run)
    for name in ("points.csv", "samples.csv", "samples.parquet", "settings.csv", "plan.toml"):
        assert facts[f"sha256 of {name}"] == file_hash(run / name)


def test_a_stopped_run_and_a_changed_file_are_warned_of(run, tmp_path):
    copy = tmp_path / "stopped"
    shutil.copytree(run, copy)
    facts = json.loads((copy / "metadata.json").read_text())
    facts |= {"state": "stopped", "reason": "thrust read 31.2 N, limit 30.0 N"}
    (copy / "metadata.json").write_text(json.dumps(facts))
    with open(copy / "samples.csv", "a") as file:
        file.write("\n")
    with pytest.warns(UserWarning, match="samples.csv has changed"):
        text = words_of(page_text([copy]))
    assert "The run was stopped: thrust read 31.2 N, limit 30.0 N." in text
    assert "samples.csv has changed since the run was closed" in text


def test_a_model_stands_beside_the_data_with_the_band_of_its_fit(run, tmp_path):
    fit = tmp_path / "fit"
    assert call("fit", str(run), "--model", "single_bench", "--out", str(fit)) == 0
    page = page_text([run], ReplayInputs(model=str(fit)))
    assert 'id="f0-1-band-95"' in page
    assert "fitted to one. Bands: covariance of the fit in fit." in words_of(page)
    own = (fit / "report.html").read_text()
    assert facts_of(own)["air"] == f"{facts_of(page)['density']}, measured"
    assert facts_of(own)["device"] == facts_of(page)["device"]
    assert write_report([fit]) == fit / "report.html"
    with pytest.raises(InputError, match="already has a page"):
        write_report([fit], replay_inputs=ReplayInputs(model="single"))
    (fit / "report.html").unlink()
    with pytest.raises(FileFormatError, match="is missing; repeat benchtool fit"):
        write_report([fit])


@pytest.mark.slow
def test_several_runs_are_compared_at_common_settings(run, other):
    page = page_text([run, other])
    check_self_contained(page)
    table, _ = common_table([read_sweep_run(run), read_sweep_run(other)])
    assert [cells[:2] for cells in table.rows] == [["0.6", "1500"], ["1", "1500"], ["2", "1500"]]
    hashes = rows_of(page, "The runs")[-1]
    assert hashes == ["sha256 of the data", *(f"{data_hash(p)[:16]}…" for p in (run, other))]
    assert data_hash(run) in page
    assert data_hash(other) in page


def test_nothing_is_written_over_unless_asked(run, tmp_path):
    out = tmp_path / "page.html"
    write_report([run], out)
    before = out.read_bytes()
    with pytest.raises(WouldOverwrite, match=r"page\.html exists .* replace it with --overwrite"):
        write_report([run], out)
    assert out.read_bytes() == before
    assert call("report", str(run), "--out", str(out)) == 2
    out.write_text("old")
    assert call("report", str(run), "--out", str(out), "--overwrite") == 0
    assert out.read_text() != "old"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ((), "no input; give a run folder"),
        (("nowhere",), "file or folder not found"),
        (("{empty}",), "(contains: nothing); give a run folder"),
        (("{run}/points.csv",), "give the run folder"),
        (("{run}", "--out", "page.pdf"), "does not end in .html"),
        (("{run}", "--motors", "1,1"), "--motors is 1,1"),
        (("{run}", "--controller", "pid"), "a sweep has no controller"),
        (("{run}", "{table}"), "benchtool import"),
    ],
)
def test_anything_else_is_refused_in_one_sentence(words, says, run, tmp_path, capsys):
    table, empty = tmp_path / "table.csv", tmp_path / "empty"
    table.write_text("a,b\n1,2\n")
    empty.mkdir()
    given = [word.format(run=run, table=table, empty=empty) for word in words]
    assert call("report", *given) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1
    assert not (run / "report.html").exists()


def test_a_run_has_a_budget_of_its_thrusts(run, page):
    """The scatter of a mean is that of its visits, and the page shows every source."""
    budget = read_sweep_run(run).budget
    assert budget is not None
    near, *_, ratio = budget.names
    assert near.startswith("thrust z/R 0.6, ")
    rows = dict(row[:1] + row[3:4] for row in rows_of(page, "Uncertainty budget"))
    assert {"repeat", "tare_offset.thrust_N *", "plate_offset.dz_m *", "combined"} <= set(rows)
    assert float(rows["combined"]) == pytest.approx(
        100.0 * budget.combined[0] / budget.values[0], rel=0.05
    )
    repeat, tare = (
        next(line for line in budget.lines if line.name == name)
        for name in ("repeat", "tare_offset.thrust_N")
    )
    measured = [line.contribution[0] for line in budget.lines if line.in_fit]
    assert math.hypot(*measured) == pytest.approx(budget.fit_sd[0], rel=1e-6)
    assert repeat.contribution[0] == max(measured)
    assert tare.contribution[0] == pytest.approx(tare.sd)
    part = tare.sd / budget.values[0] - tare.sd / budget.values[2]
    assert tare.contribution[-1] == pytest.approx(abs(part * budget.values[-1]))
    assert ratio.startswith(f"{near} over thrust far")
