"""The catalogue: what it finds, what it answers, and that the folders stay the truth."""

from __future__ import annotations

import json
import shutil
import sqlite3
import threading
from pathlib import Path
from typing import Any

import pytest

import benchtool as bt
from benchtool.core.errors import InputError
from benchtool.core.inputs import build_inputs
from benchtool.data.catalogue.entry import ChoiceInputs
from benchtool.data.catalogue.index import find_entries, index_folder, load_entries
from benchtool.data.run import entry as run_list
from benchtool.data.run.entry import Entry, build_entry, update_labels
from benchtool.data.run.runs_folder import RunsFolder
from tests.unit.commands.command_line import said
from tests.unit.data.run_of import small_run

TOP = Path(__file__).parents[3]


def rig_facts(name: str, radius_m: float) -> dict[str, Any]:
    facts: dict[str, Any] = json.loads(
        (TOP / "datasets" / "quad" / "run" / "metadata.json").read_text("utf-8")
    )
    rig: dict[str, Any] = facts["rig"] | {"name": name}
    rig["propulsion"] = rig["propulsion"] | {"radius_m": radius_m}
    return rig


@pytest.fixture
def root(tmp_path, monkeypatch):
    """Give three runs and a fit; the distance is 0.1 m everywhere (see `run_of`)."""
    monkeypatch.setenv("BENCHTOOL_STATE", str(tmp_path / "state"))
    root = tmp_path / "runs"
    for name, day, rig, radius_m, operator in (
        ("2026/one", "02", "lab", 0.1, "ada"),
        ("2026/two", "12", "lab", 0.2, "Bob"),
        ("three", "22", "hall", 0.05, "ada"),
    ):
        run = small_run(root / name)
        run.update_metadata(
            started=f"2026-03-{day}T12:00:00+00:00", state="ended", operator=operator,
            rig=rig_facts(rig, radius_m),
        )  # fmt: skip
        run.close()
    shutil.copytree(TOP / "fits" / "quad", root / "fit")
    update_labels(root / "three", add=["good", "first-day"], note="the propeller has a nick")
    return root


def names(root: Path, **by: Any) -> set[str]:
    found = find_entries(build_inputs(ChoiceInputs, {"folder": (root,), **by}))
    return {entry.name for _, entry in found}


@pytest.mark.parametrize(
    ("by", "expected"),
    [
        ({"rig": "LAB"}, {"2026/one", "2026/two"}),
        ({"operator": "ada", "kind": "sweep"}, {"2026/one", "three"}),
        ({"since": "2026-03-12", "until": "2026-03-21"}, {"2026/two"}),
        ({"z_over_r": (0.4, 0.6)}, {"2026/two"}),
        ({"tag": ("good", "first-day")}, {"three"}),
        ({"words": "nick ada"}, {"three"}),
        ({"state": "converged"}, {"fit"}),
        ({"fitted": ("body_lift.K_b=1.8..1.95",)}, {"fit"}),
        ({"fitted": ("K_b=2..3",)}, set()),
    ],
)
def test_entries_are_found_by(root, by, expected):
    assert names(root, **by) == expected


@pytest.mark.parametrize(
    ("by", "said"),
    [
        ({"since": "March"}, "since is 'March'; give a date"),
        ({"z_over_r": (2.0, 1.0)}, "z-over-r is 2 to 1; give the smaller limit first"),
        ({"fitted": ("K_b=2",)}, "fitted is 'K_b=2'; give a parameter, optionally with limits"),
        ({"fitted": ("K_b=3..2",)}, "fitted is 'K_b=3..2'"),
        ({"kind": "swep"}, "kind"),
        ({"folder": (Path("nowhere"),)}, "there is no folder nowhere"),
    ],
)
def test_a_wrong_choice_is_refused(root, by, said):
    with pytest.raises(InputError, match=said):
        names(root, **by)


def test_only_what_changed_is_read_again(root, monkeypatch):
    first = load_entries(root)
    read: list[str] = []

    def noted(folder: RunsFolder, name: str) -> Entry:
        read.append(name)
        return build_entry(folder, name)

    monkeypatch.setattr(run_list, "build_entry", noted)
    assert load_entries(root) == first
    assert read == []
    update_labels(root / "2026" / "one", add=["x"])
    shutil.rmtree(root / "three")
    again = {entry.name: entry for entry in load_entries(root)}
    assert read == ["2026/one"]
    assert again["2026/one"].tags == ("x",)
    assert "three" not in again
    read.clear()
    assert {entry.name for entry in load_entries(root, rebuild=True)} == again.keys()
    assert sorted(read) == sorted(again)


@pytest.mark.parametrize("damage", ["lost", "garbage", "another version"])
def test_a_damaged_index_is_made_anew(root, damage):
    whole = load_entries(root)
    assert len(bt.runs(root).query("SELECT * FROM settings"))
    file = index_folder(root) / "index.sqlite"
    if damage == "lost":
        shutil.rmtree(file.parent)
    elif damage == "garbage":
        file.write_bytes(b"no database at all, " * 500)
    else:
        store = sqlite3.connect(file)
        store.execute("PRAGMA user_version = 0")
        store.close()
    assert load_entries(root) == whole
    assert len(bt.runs(root).query("SELECT * FROM settings")) == 6


def test_a_query_says_what_the_files_hold(root):
    runs = bt.runs(root, rig="lab")
    assert {path.name for path in runs} == {"one", "two"}
    means = runs.query(
        "SELECT z_over_r, avg(ratio_equal_pwm) AS ratio FROM settings WHERE kind = 'measure' "
        "GROUP BY ALL ORDER BY 1"
    )
    # Thrusts of `small_run`: 11 and 11.424 N over 10 and 10.2 N.
    assert means["z_over_r"].tolist() == pytest.approx([0.5, 1.0])
    assert means["ratio"].tolist() == pytest.approx([(1.1 + 1.12) / 2] * 2)
    counted = runs.query("SELECT run, count(*) AS n, sum(thrust_N) AS s FROM samples GROUP BY run")
    assert set(counted["run"]) == {str(root / "2026" / "one"), str(root / "2026" / "two")}
    assert counted["n"].tolist() == [10, 10]
    assert counted["s"].tolist() == pytest.approx([2 * (1.25 + 0.3 - 3.0)] * 2)
    joined = runs.query(
        "SELECT runs.operator FROM points JOIN runs USING (run) WHERE points.kind = 'tare'"
    )
    assert sorted(joined["operator"]) == ["Bob", "ada"]


def test_fits_are_a_table_of_their_parameters(root):
    result = json.loads((root / "fit" / "result.json").read_text("utf-8"))
    table = bt.runs(root).query("SELECT * FROM fits WHERE parameter = 'body_lift.K_b'")
    assert list(table["method"]) == ["least_squares", "emcee"]
    for _, row in table.iterrows():
        stated = result["results"][row["method"]]
        one = stated["estimates"]["body_lift.K_b"]
        assert (row["value"], row["sd"], row["unit"]) == (one["value"], one["sd"], one["unit"])
        assert [row["low_95"], row["high_95"]] == one["interval_95"]
        assert (row["model"], row["verdict"]) == ("quad_bench", stated["facts"]["verdict"])
        assert row["run"] == str(root / "fit")
    combined = [
        one["estimates"]["body_lift.K_b"]["combined_sd"] for one in result["results"].values()
    ]
    assert list(table["combined_sd"]) == combined
    assert combined[0] == result["budget"]["quantities"]["body_lift.K_b"]["combined"]


@pytest.mark.parametrize(
    ("sql", "said"),
    [
        ("SELECT foo FROM points", "DuckDB rejects the query: .*foo"),
        ("SELECT * FROM bar", "available tables: runs, settings, points, samples and fits"),
        ("COPY (SELECT 1) TO 'x.csv'", "the query is not a single SELECT"),
        ("SELECT 1; SELECT 2", "the query is not a single SELECT"),
        ("", "the query is not a single SELECT"),
    ],
)
def test_a_query_that_is_none_is_refused(root, sql, said):
    with pytest.raises(InputError, match=said):
        bt.runs(root).query(sql)


def test_a_run_that_is_being_measured_is_listed_and_queried(root):
    run = small_run(root / "live")
    run.update_metadata(state="running", rig=rig_facts("lab", 0.1))
    with run.locked():
        with (run.path / "points.csv").open("ab") as growing:
            growing.write(b"5,measure,1,3,50")  # a row that is not complete yet
        live = bt.runs(root, words="live")
        assert [entry.state for _, entry in live.entries] == ["running"]
        assert len(live.query("SELECT * FROM points")) == 5
        with pytest.raises(InputError, match=r"no samples: no run is closed"):
            live.query("SELECT * FROM samples")
        update_labels(run.path, add=["live"])
    run.update_metadata(state="ended")
    assert names(root, tag=("live",)) == {"live"}


def test_labels_of_two_programs_are_both_there(root):
    def add(first: int) -> None:
        for number in range(first, first + 10):
            update_labels(root / "three", add=[f"t{number}"])

    both = [threading.Thread(target=add, args=(first,)) for first in (0, 10)]
    for one in both:
        one.start()
    for one in both:
        one.join()
    entry = next(one for one in load_entries(root) if one.name == "three")
    assert {f"t{number}" for number in range(20)} <= set(entry.tags)


@pytest.mark.parametrize(
    "tag", ["two words", "a,b", "", "x" * 61, "a\x1b[2J", "a\u202eb", "-a", "a/b"]
)
def test_a_word_that_is_no_tag_is_refused(root, tag):
    with pytest.raises(InputError, match="cannot name a tag"):
        update_labels(root / "three", add=[tag])
    with pytest.raises(InputError, match=r"has no tag 'other' to remove \(it has: good, first-day"):
        update_labels(root / "three", remove=["other"])


def test_all_of_a_tag_command_is_checked_before_the_first_run_changes(root, capsys):
    before = (root / "three" / "labels.json").read_bytes()
    for arguments in (["three", "best"], ["three", "nowhere", "--add", "best"],
                      ["three", "2026/one", "--remove", "good"]):  # fmt: skip
        paths = [word if word.startswith("-") else str(root / word) for word in arguments[:2]]
        code, out, why = said(capsys, "runs", "tag", *paths, *arguments[2:])
        assert code == 2
        assert out == ""
        assert "and tags with --add" in why or "has no tag 'good' to remove" in why
        assert (root / "three" / "labels.json").read_bytes() == before
