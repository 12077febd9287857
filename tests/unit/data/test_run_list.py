from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from benchtool.data.catalogue.index import list_entries
from benchtool.data.run.entry import Entry
from benchtool.data.run.runs_folder import RunsFolder
from tests.unit.data.run_of import small_run

TOP = Path(__file__).parents[3]


@pytest.fixture
def folder(tmp_path):
    root = tmp_path / "runs"
    run = small_run(root / "one")
    run.update_metadata(started="2026-03-02T10:00:00+00:00", state="stopped", reason="Ctrl-C")
    shutil.copytree(TOP / "datasets" / "quad" / "run", root / "quad")
    shutil.copytree(TOP / "fits" / "quad", root / "fits" / "quad")
    (root / "answer").mkdir()
    answer = {"verdict": "named", "sentence": "A cable pulls.", "model": "m", "simulated": False}
    (root / "answer" / "answer.json").write_text(json.dumps(answer), "utf-8")
    (root / "lab.csv").write_text("gap_mm;F_gf\n60;424,1\n", "utf-8")
    return RunsFolder(root)


def named(folder: RunsFolder) -> dict[str, Entry]:
    return {entry.name: entry for entry in list_entries(folder)}


def test_everything_is_listed_with_what_it_is(folder):
    found = named(folder)
    assert {name: entry.kind for name, entry in found.items()} == {
        "one": "sweep",
        "quad": "sweep",
        "fits/quad": "fit",
        "answer": "explanation",
        "lab.csv": "table",
    }
    assert not any(entry.problem for entry in found.values())
    quad = found["quad"]
    assert (quad.rig, quad.state, quad.simulated) == ("pquad", "ended", True)
    assert quad.summary == "96 points"
    assert found["one"].summary == "4 points; Ctrl-C"
    assert found["one"].date.startswith("2026-03-02")
    assert (found["fits/quad"].rig, found["fits/quad"].state) == ("quad_bench", "converged")
    assert found["answer"].summary == "A cable pulls."
    assert found["lab.csv"].summary == "gap_mm, F_gf"


def test_what_is_broken_is_listed_with_its_reason(folder):
    root = folder.root
    for name in ("json", "format", "points", "none", "rig"):
        small_run(root / name)
    (root / "json" / "metadata.json").write_text("{", "utf-8")
    (root / "format" / "metadata.json").write_text('{"format": "benchtool-run-9"}', "utf-8")
    (root / "points" / "points.csv").write_text("point,kind\n1,bogus\n", "utf-8")
    (root / "none" / "metadata.json").unlink()
    (root / "rig" / "metadata.json").write_text('{"format": "benchtool-run-1", "rig": 3}', "utf-8")
    (root / "empty").mkdir()
    (root / "fits" / "quad" / "result.json").write_text('{"format": "benchtool-fit-1"}', "utf-8")
    (root / "answer" / "answer.json").write_text("[1]", "utf-8")
    (root / "away").symlink_to(root.parent)
    found = named(folder)
    said = {
        "json": "json/metadata.json: this is not valid JSON",
        "format": "format 'benchtool-run-9' is not supported; allowed: 'benchtool-run-1'",
        "points": "line 2: column 'kind' contains 'bogus'",
        "none": "there is no metadata.json in it",
        "rig": "rig is 3: input should be a table",
        "empty": "contents: none",
        "fits/quad": "key 'model' is missing in its JSON",
        "answer": "a JSON object is needed",
        "away": "is outside the runs folder",
    }
    for name, words in said.items():
        assert words in found[name].problem, name
        assert str(root) not in found[name].problem
        assert "\n" not in found[name].problem
        assert not found[name].can_fit
    assert found["quad"].problem == ""
