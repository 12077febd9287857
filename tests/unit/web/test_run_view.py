"""What the Runs tab shows, compares and hands out, from a runs folder and from nowhere else."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from benchtool.core.errors import BenchtoolError, InputError
from benchtool.data.run.entry import entry_of
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.web.tabs.runs.detail import downloads
from benchtool.web.tabs.runs.view import (
    report_bytes,
    table_bytes,
    view_comparison,
    view_entry,
    view_part,
)

TOP = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("any") / "runs"
    for name in ("quad", "single_rotor"):
        shutil.copytree(TOP / "datasets" / name / "run", root / name)
    shutil.copytree(TOP / "fits" / "quad", root / "fit")
    (root / "fit" / "report.html").write_text("<!doctype html><p>as written</p>", "utf-8")
    for name in ("check.parquet", "check.parquet.json"):
        shutil.copy(TOP / "datasets/pitch_friction" / name, root / name)
    (root / "answer").mkdir()
    answer = {
        "verdict": "named",
        "sentence": "A <b>cable</b> pulls.",
        "model": "pitch_beam",
        "simulated": False,
        "data": {"learn": {"a.csv": "0"}, "check": {"b.csv": "1"}},
        "next_experiment": {"title": None},
    }
    (root / "answer" / "answer.json").write_text(json.dumps(answer), "utf-8")
    (root / "answer" / "gap.svg").write_text("<svg><script>alert(1)</script></svg>", "utf-8")
    (root / "lab.csv").write_text("F,rpm1\n1,<script>\n", "utf-8")
    shutil.copytree(root / "quad", root / "broken")
    (root / "broken" / "metadata.json").write_text("{", "utf-8")
    (root.parent / "secret.csv").write_text("F\n1\n", "utf-8")
    return root


def test_a_sweep_shows_its_numbers_and_offers_its_tables(root: Path) -> None:
    shown, parts = view_entry(root, "quad")
    html = shown.html
    assert shown.simulated
    assert shown.command == ("report", str(root / "quad"))
    for text in ("pquad: PQUAD quadrotor", "T_IGE/T_OGE", "80 visits of 16 settings", "1.8089"):
        assert text in html
    assert html.count("data:image/svg+xml") == 3
    assert "Plan" in parts
    assert "distances" in view_part(root, "quad", "Plan").html
    with pytest.raises(InputError, match="has no part 'Nonsense'"):
        view_part(root, "quad", "Nonsense")
    found = downloads(entry_of(RunsFolder(root), "quad"))
    assert [download.file for download in found] == [
        *("quad-report.html", "quad-points.csv", "quad-settings.csv"),
        *("quad-samples.csv", "quad-samples.parquet"),
    ]
    assert table_bytes(root, "quad", "points", ".csv").startswith(b"point,kind,setting,")


def test_a_fit_shows_what_the_command_prints(root: Path) -> None:
    shown, parts = view_entry(root, "fit")
    html = shown.html
    assert parts == ()
    for text in ("1.892 ± 0.022", "1.849 … 1.934", "95 % interval", "quad is clearly behind"):
        assert text in html
    assert html.count("data:image/svg+xml") == 2
    assert report_bytes(root, ("fit",)) == b"<!doctype html><p>as written</p>"


def test_what_is_in_a_file_is_never_markup(root: Path) -> None:
    for name in ("answer", "lab.csv"):
        html = view_entry(root, name)[0].html
        assert "<script" not in html
        assert "<b>cable" not in html


@pytest.mark.parametrize("name", ["../secret.csv", "quad/../../secret.csv", "/etc/passwd", "none"])
def test_nothing_outside_is_shown_compared_or_handed_out(root: Path, name: str) -> None:
    for take in (
        lambda: view_entry(root, name),
        lambda: view_part(root, name, "Plan"),
        lambda: view_comparison(root, ("quad", name)),
        lambda: report_bytes(root, (name,)),
        lambda: table_bytes(root, name, "points", ".csv"),
    ):
        with pytest.raises(BenchtoolError):
            take()
