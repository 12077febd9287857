"""What closing adds to a run, and what it finds in samples.csv."""

from __future__ import annotations

import numpy as np
import pyarrow.parquet as pq
import pytest

from benchtool.core.errors import FileFormatError, InputError, ResourceExhausted
from benchtool.data.run.append import (
    Event,
    install_marked_samples,
    read_events,
    write_marked_samples,
)
from benchtool.data.run.read import read_samples
from benchtool.data.run.run import ENDED_UNEXPECTEDLY, Run, has_rows, remove_leftovers
from tests.unit.data.run_of import small_run

ALL = "closed afterwards; all is measured: 4 visits"


@pytest.mark.parametrize(
    ("state", "planned", "visits", "closed", "said"),
    [
        ("running", 4, None, "ended", ALL),
        ("stopped", 4, None, "ended", ALL),
        ("running", 5, None, "stopped", f"closed afterwards; {ENDED_UNEXPECTEDLY}"),
        ("running", None, None, "stopped", f"closed afterwards; {ENDED_UNEXPECTEDLY}"),
        ("running", 5, 4, "ended", ALL),
        ("stopped", 5, None, "stopped", None),
        ("stopped", None, None, "stopped", None),
        ("ended", 5, None, "ended", None),
    ],
)
def test_how_a_run_ended_is_said_once(tmp_path, state, planned, visits, closed, said):
    run = small_run(tmp_path / "run")
    run.update_metadata(state=state, visits=planned)
    with run.locked() as log:
        log.append(Event(7.5, "tare", "tared"))
    assert run.close(visits)
    assert run.metadata["state"] == closed
    died = (state, closed) == ("running", "stopped")
    assert run.metadata.get("reason") == (ENDED_UNEXPECTEDLY if died else None)
    events = [(one.time_s, one.event, one.text) for one in read_events(run.path / "events.jsonl")]
    assert events[1:] == ([(7.5, "closed", said)] if said else [])
    before = {path.name: path.read_bytes() for path in run.path.iterdir()}
    assert not run.close(visits)
    assert {path.name: path.read_bytes() for path in run.path.iterdir()} == before


def test_an_event_that_a_killed_close_had_written_is_not_repeated(tmp_path):
    run = small_run(tmp_path / "run")
    run.update_metadata(state="running", visits=4)
    with run.locked() as log:
        log.append(Event(0.0, "closed", ALL))
    run.close()
    assert len(read_events(run.path / "events.jsonl")) == 1


def test_a_run_that_is_measured_or_closed_by_another_is_left_alone(tmp_path):
    run = small_run(tmp_path / "run")
    with run.locked(), pytest.raises(InputError, match="is in use by another process"):
        run.close()


def test_left_overs_are_hidden_files_that_were_being_written(tmp_path):
    for name in (".metadata.json.7.new", ".x.new", "x.new", ".x.newer", ".x"):
        (tmp_path / name).touch()
    (tmp_path / ".folder.new").mkdir()
    remove_leftovers(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"x.new", ".x.newer", ".x", ".folder.new"}


@pytest.mark.parametrize("error", [MemoryError(), OSError(28, "No space left on device")])
def test_a_writer_that_fails_ends_the_close_and_leaves_nothing(tmp_path, monkeypatch, error):
    run = small_run(tmp_path / "run")

    def fail(writer: pq.ParquetWriter, batch: object) -> None:
        raise error

    with monkeypatch.context() as patch:
        patch.setattr(pq.ParquetWriter, "write_batch", fail)
        with pytest.raises(ResourceExhausted, match="run cannot be closed"):
            run.close()
    assert not list(run.path.glob("*parquet*"))
    assert "samples" not in run.metadata
    assert run.close()
    assert (run.path / "samples.parquet").is_file()


@pytest.mark.parametrize(
    ("lines", "problem"),
    [
        ("\n1,2,3,settle,1,2,3\n\n5,6,7,settle,8,9\n", "line 15 has 6 cells, its header 7"),
        ("1,2,3,settle,1,2,3\n1,2,3,settle,1,2,3,4\n", "line 13 has 8 cells, its header 7"),
        ('1,2,3,settle,"1",2,3\n', "column 'pwm1_us'"),
        ("1,2,3,settle,1,2 3,3\n", "column 'rpm1'"),
    ],
)
def test_a_line_that_cannot_be_read_is_named(tmp_path, lines, problem):
    run = small_run(tmp_path / "run")
    with open(run.path / "samples.csv", "a") as file:
        file.write(lines)
    with pytest.raises(FileFormatError, match=problem):
        run.close()
    assert not list(run.path.glob("*parquet*"))


def test_blank_lines_and_spaces_change_no_number(tmp_path):
    run = small_run(tmp_path / "run")
    path = run.path / "samples.csv"
    rows = read_samples(path).values
    text = path.read_text().replace(",1500.0", ", 1500.0 ").replace("\n", "\r\n\r\n")
    path.write_bytes(text.encode())
    run.close()
    path.unlink()
    assert np.array_equal(read_samples(run.path).values, rows, equal_nan=True)


@pytest.mark.parametrize("name", ["samples.csv", "samples.parquet"])
def test_samples_are_sealed_again_where_either_file_has_changed(tmp_path, name):
    run = small_run(tmp_path / "run")
    run.close()
    with open(run.path / name, "ab") as file:
        file.write(b"1.0,1,0,move,,,\n")
    assert run.close()
    assert read_samples(run.path).provenance["file"].endswith("samples.parquet")
    assert len(read_samples(run.path)) == 10 + (name == "samples.csv")
    (run.path / "samples.parquet").unlink()
    assert run.close()
    assert not run.close()


def test_a_run_with_a_link_for_its_samples_is_not_closed(tmp_path):
    run = small_run(tmp_path / "run")
    run.close()
    parquet = run.path / "samples.parquet"
    parquet.symlink_to(parquet.rename(tmp_path / "elsewhere"))
    with pytest.raises(FileFormatError, match=r"samples\.parquet: this is a symbolic link"):
        run.close()


def test_settings_that_are_missing_are_made_again(tmp_path):
    run = small_run(tmp_path / "run")
    (run.path / ".settings.csv.7.new").write_text("half")
    run.close()
    assert not list(run.path.glob(".*"))
    (run.path / "settings.csv").unlink()
    assert run.close()
    assert (run.path / "settings.csv").is_file()


def test_a_run_without_rows_is_closed_without_tables(tmp_path):
    run = Run.create(tmp_path / "run", "", {"state": "ended"})
    (run.path / "points.csv").write_text("point,kind\n")
    assert not has_rows(run.path / "points.csv")
    assert not run.close()
    assert {path.name for path in run.path.iterdir()} == {
        *("plan.toml", "metadata.json", "points.csv", "events.jsonl")
    }


HEAD = "time_s,device_time_us,point,phase,rpm1,rpm2\n"
ROWS = ("1,10,0,move,1,\n", "9,20,1,sample,2,\n", "3,30,2,settle,3,3\n", "4,40,2,interrupted,4,\n",
        "5,45,0,end,5,\n")  # fmt: skip


def test_rows_of_visits_that_were_cut_short_are_found_and_marked(tmp_path):
    path = tmp_path / "samples.csv"
    cut = "6,50,2,settle,6"
    path.write_text(HEAD + "".join(ROWS) + cut)
    write_marked_samples(path, frozenset({1, 2}))
    assert list(tmp_path.iterdir()) == [path]
    found = write_marked_samples(path, frozenset({1}))
    assert (found.rows, found.last_s) == (5, 9.0)
    assert path.read_text() == HEAD + "".join(ROWS) + cut
    install_marked_samples(path)
    marked = ROWS[2].replace("settle", "interrupted")
    assert path.read_text() == HEAD + ROWS[0] + ROWS[1] + marked + ROWS[3] + ROWS[4] + cut
    install_marked_samples(path)  # nothing was written since
    write_marked_samples(path, frozenset({1}))
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    "line",
    [
        *("x,10,1,sample,1", "1,x,1,sample,1", "1,10,x,sample,1", "1,10,-1,sample,1", "1,10,1"),
        *("nan,10,1,sample,1", "1e300,10,1,sample,1", "1,1e300,1,sample,1"),
    ],
)
def test_a_line_that_no_writer_has_written_is_named(tmp_path, line):
    path = tmp_path / "samples.csv"
    path.write_text(HEAD + ROWS[0] + line + "\n")
    with pytest.raises(FileFormatError, match=r"samples\.csv, line 3: it starts with '"):
        write_marked_samples(path, frozenset())
