"""Points that were changed after their run was closed say so at every reading."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchtool.core.errors import BenchtoolError, DataWarning
from benchtool.data.run.entry import verify_run
from benchtool.data.run.read import changed_points, read_points
from benchtool.data.run.run_writer import RunWriter
from tests.unit.data.run_of import CHANNELS, point, small_run


@pytest.fixture
def closed(tmp_path):
    run = small_run(tmp_path / "run")
    run.update_metadata(state="running", visits=4)
    run.close()
    return run


def edit(folder: Path) -> None:
    file = folder / "points.csv"
    file.write_text(file.read_text("utf-8").replace(",11.0,", ",11.165,"), "utf-8")


def test_a_closed_run_states_the_hash_of_its_points(closed):
    assert changed_points(closed.path) == changed_points(closed.path / "points.csv") == ()
    assert verify_run(closed.path) == []
    edit(closed.path)
    for path in (closed.path, closed.path / "points.csv"):
        with pytest.warns(DataWarning, match=str(closed.path / "points.csv")):
            assert read_points(path).column("thrust_N")[0] == 11.165
    with pytest.warns(DataWarning):
        assert verify_run(closed.path) == ["points.csv has changed since the run was closed"]
    (closed.path / "points.csv").unlink()
    assert "points.csv" in verify_run(closed.path)[0]


def test_closing_again_does_not_state_the_hash_of_changed_points(closed):
    edit(closed.path)
    (closed.path / "settings.csv").unlink()
    with pytest.warns(DataWarning):
        assert closed.close()
    assert changed_points(closed.path)


@pytest.mark.parametrize("left", ["open", "killed", "closed"])
def test_points_of_a_resumed_run_give_no_warning(closed, left):
    with (closed.path / "points.csv").open("a") as file:
        file.write("5,meas")  # as a kill leaves it
    closed.update_metadata(points={}, samples={})
    closed.close()
    writer = RunWriter(closed, CHANNELS, 1)
    writer.point(point(5, "measure", 1, 3, 11.1))
    if left != "open":
        writer.close()
    if left == "closed":
        closed.close()
    assert len(read_points(closed.path)) == 5
    writer.close()


def test_resuming_does_not_hide_a_change(closed):
    edit(closed.path)
    writer = RunWriter(closed, CHANNELS, 1)
    writer.point(point(5, "measure", 1, 3, 11.1))
    writer.close()
    with pytest.warns(DataWarning):
        closed.close()
    assert changed_points(closed.path)


def test_verify_finds_what_changed(closed):
    run = closed.path
    assert verify_run(run) == []
    with (run / "samples.parquet").open("ab") as changed:
        changed.write(b"x")
    assert verify_run(run) == ["samples.parquet has changed since the run was closed"]
    (run / "samples.csv").unlink()
    assert verify_run(run)[0] == "samples.csv is missing"
    (run / "points.csv").write_text("point,kind\n1,bogus\n")
    assert "bogus" in verify_run(run)[0]
    with pytest.raises(BenchtoolError):
        verify_run(run.parent / "none")
