"""Merged runs: what is in them, what they refuse, and that a fit of one is that of its runs."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchtool.core.errors import BenchtoolError, DataWarning, InputError, WouldOverwrite
from benchtool.data.atomic import data_hash
from benchtool.data.run.entry import verify_run
from benchtool.data.run.merge import merge_runs
from benchtool.data.run.read import find_parts, read_points
from benchtool.data.run.run import Run, read_settings
from benchtool.fit.recipe import Recipe
from benchtool.fit.run_recipe import run_recipe
from tests.unit.data.run_of import small_run

DATA = Path(__file__).parents[3] / "datasets" / "single_rotor" / "run"


def contents(folder: Path) -> dict[Path, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder): path.read_bytes() for path in files}


def changed(path: Path, factor: float, **facts: Any) -> Path:
    """Return a copy of a shipped run with other thrusts, so that it holds other data."""
    shutil.copytree(DATA, path)
    points = path / "points.csv"
    head, *rows = points.read_text("utf-8").splitlines()
    at = head.split(",").index("thrust_N")
    cells = [row.split(",") for row in rows]
    for row in cells:
        row[at] = repr(factor * float(row[at]))
    points.write_text("\n".join([head, *(",".join(row) for row in cells)]) + "\n", "utf-8")
    Run(path).update_metadata(**facts)
    return path


@pytest.fixture
def two(tmp_path):
    air = {"temperature_degC": 20.0, "pressure_Pa": 101325.0, "humidity": 0.5,
           "density_kg_m3": 1.2, "measured": True}  # fmt: skip
    facts = Run(DATA).metadata
    cell = facts.get("calibration") or {}
    return [
        changed(tmp_path / "one", 1.0, air=air, calibration=cell or None),
        changed(tmp_path / "two", 1.004, air=air | {"temperature_degC": 24.0}),
    ]


def test_the_fit_of_a_merged_run_is_that_of_its_runs(two, tmp_path):
    merged = merge_runs(two, tmp_path / "merged")
    recipe = Recipe(
        name="x", data=tuple(map(str, two)), model="single_bench",
        methods=("least_squares",),
    )  # fmt: skip
    apart, together = (
        run_recipe(one) for one in (recipe, replace(recipe, data=(str(merged.path),)))
    )
    assert together.results[0].estimates == apart.results[0].estimates
    np.testing.assert_array_equal(together.results[0].covariance, apart.results[0].covariance)
    assert together.density == apart.density


def test_a_merged_run_holds_its_runs_and_all_their_points(two, tmp_path):
    before = [contents(path) for path in two]
    merged = merge_runs(two, tmp_path / "merged").path
    assert [contents(path) for path in two] == before
    assert [contents(Path(part)) for part in find_parts(merged)] == before
    facts = Run(merged).metadata
    assert [one["sha256"] for one in facts["merged_from"]] == [data_hash(path) for path in two]
    assert [one["from"] for one in facts["merged_from"]] == [str(path) for path in two]
    assert facts["air"]["temperature_degC"] == 22.0
    points, parts = read_points(merged), [read_points(path) for path in two]
    np.testing.assert_array_equal(
        points.column("thrust_N"), np.concatenate([part.column("thrust_N") for part in parts])
    )
    assert len(np.unique(points.column("point"))) == sum(map(len, parts))
    assert (np.diff(points.column("time_s")) > 0.0).all()
    # A visit is divided by the references of its own run.
    ratios = read_settings(merged).column("ratio_equal_pwm")
    own = [read_settings(path).column("ratio_equal_pwm") for path in two]
    assert ratios == pytest.approx(np.concatenate([own[0], own[0]]), nan_ok=True)
    with pytest.raises(WouldOverwrite):
        merge_runs(two, merged)


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        ({"rig": {"propeller": {"name": "other"}}}, "one is of propeller .* and .*two of 'other'"),
        ({"rig": {"name": "other"}}, "is of rig .*; merge runs of one rig"),
        ({"rig": {"propulsion": {"radius_m": 0.3}}}, "have different rigs .rotor radius"),
        ({"state": "running"}, "two is being measured, or its program was killed"),
    ],
)
def test_other_runs_are_refused(two, tmp_path, facts, said):
    file = two[1] / "metadata.json"
    known = json.loads(file.read_text("utf-8"))
    for key, value in facts.items():
        if isinstance(value, str):
            known[key] = value
            continue
        for inner, one in value.items():
            table = known[key].get(inner)
            known[key][inner] = (table or {}) | one if isinstance(one, dict) else one
    if "propeller" in facts.get("rig", {}):
        known["rig"]["propeller"] = {"name": "other", "diameter_m": 0.24}
    file.write_text(json.dumps(known), "utf-8")
    with pytest.raises(InputError, match=said):
        merge_runs(two, tmp_path / "merged")
    assert {item.name for item in tmp_path.iterdir()} == {"one", "two"}


def test_the_same_data_and_a_single_run_are_refused(two, tmp_path):
    with pytest.raises(InputError, match="only one run"):
        merge_runs(two[:1], tmp_path / "merged")
    with pytest.raises(InputError, match="duplicate data"):
        merge_runs([two[0], two[0]], tmp_path / "merged")


def test_a_part_that_is_missing_or_changed_is_said(tmp_path):
    merged = merge_runs(closed_pair(tmp_path), tmp_path / "merged").path
    assert verify_run(merged) == []
    part = Path(find_parts(merged)[1])
    with (part / "points.csv").open("a") as file:
        file.write((part / "points.csv").read_text("utf-8").splitlines()[-1] + "\n")
    with pytest.warns(DataWarning):
        assert verify_run(merged) == ["002-two: points.csv has changed since the run was closed"]
    Run.open(part).update_metadata(points={})
    assert verify_run(merged) == ["002-two: its data have changed"]
    shutil.rmtree(part)
    with pytest.raises(BenchtoolError, match="contains 1 of the 2 runs in"):
        find_parts(merged)


def closed_pair(tmp_path: Path) -> list[Path]:
    """Return two runs of 11 and 24 N over 10 and 20 N, and 11.424 over 10.2."""
    one, two = small_run(tmp_path / "one").path, small_run(tmp_path / "two").path
    text = (two / "points.csv").read_text("utf-8").replace(",10.0,", ",20.0,")
    (two / "points.csv").write_text(text.replace(",11.0,", ",24.0,"), "utf-8")
    rig = Run(DATA).metadata["rig"]
    for path in (one, two):
        Run(path).update_metadata(rig=rig, state="ended")
        Run(path).close()
    return [one, two]


def test_ratios_do_not_take_references_of_another_part(tmp_path):
    merged = merge_runs(closed_pair(tmp_path), tmp_path / "merged").path
    table = read_settings(merged)
    near = table.column("kind") == 0.0
    assert table.column("ratio_equal_pwm")[near] == pytest.approx([1.11, (24.0 / 20.0 + 1.12) / 2])
