"""Views, comparisons and downloads of the Runs tab, limited to the runs folder."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from benchtool.core.errors import BenchtoolError
from benchtool.data.run.entry import Entry
from benchtool.web.entries import (
    report_bytes,
    table_bytes,
    view_comparison,
    view_entry,
    view_part,
)
from benchtool.web.tabs.runs import _row

TOP = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    root = tmp_path_factory.mktemp("any") / "runs"
    shutil.copytree(TOP / "datasets" / "quad" / "run", root / "quad")
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
    (root.parent / "secret.csv").write_text("F\n1\n", "utf-8")
    return root


def test_what_is_in_a_file_is_never_markup(root):
    for name in ("answer", "lab.csv"):
        html = view_entry(root, name)[0].html
        assert "<script" not in html
        assert "<b>cable" not in html


@pytest.mark.parametrize("name", ["../secret.csv", "quad/../../secret.csv", "/etc/passwd", "none"])
def test_nothing_outside_is_shown_compared_or_handed_out(root, name):
    for access in (
        lambda: view_entry(root, name),
        lambda: view_part(root, name, "Plan"),
        lambda: view_comparison(root, ("quad", name)),
        lambda: report_bytes(root, (name,)),
        lambda: table_bytes(root, name, "points", ".csv"),
    ):
        with pytest.raises(BenchtoolError):
            access()


@pytest.mark.parametrize("state", ["stopped", "ended"])
def test_a_stopped_run_is_not_called_unreadable(state):
    entry = Entry(name="a", kind="pitch recording", state=state, problem="a: it has no samples")
    row = _row(entry)
    assert (row["problem"], row["summary"]) == (state == "ended", "it has no samples")
