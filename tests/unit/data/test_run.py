from __future__ import annotations

import errno
import json
import os
import sys

import numpy as np
import pytest

from benchtool.core.errors import FileFormatError, InputError, UnknownChoice, WouldOverwrite
from benchtool.data.atomic import data_hash, json_ready
from benchtool.data.columns import KINDS, to_frame, word_to_code
from benchtool.data.run.append import (
    AppendFile,
    Event,
    EventLog,
    install_marked_samples,
    read_events,
    write_marked_samples,
)
from benchtool.data.run.read import read_points, read_samples
from benchtool.data.run.run import Run, free_run_path, read_settings
from tests.unit.data.run_of import CHANNELS, point, small_run


def test_nothing_is_written_over(tmp_path):
    run = small_run(tmp_path / "run")
    before = (run.path / "points.csv").read_bytes()
    with pytest.raises(WouldOverwrite):
        Run.create(run.path, "", {})
    assert (run.path / "points.csv").read_bytes() == before


def test_a_second_run_of_one_name_gets_a_number(tmp_path):
    first = free_run_path(tmp_path, "2026-01-31", "quad")
    first.mkdir()
    assert first.name == "2026-01-31-quad"
    assert free_run_path(tmp_path, "2026-01-31", "quad").name == "2026-01-31-quad-2"
    with pytest.raises(InputError, match="cannot name a run"):
        free_run_path(tmp_path, "2026-01-31", "../x")


def test_samples_read_back_to_the_bit_with_empty_cells(tmp_path):
    run = small_run(tmp_path / "run")
    lines = (run.path / "samples.csv").read_text().splitlines()
    assert lines[0] == "time_s,device_time_us,point,phase,pwm1_us,rpm1,thrust_N"
    assert lines[2] == "0.005000,5000,1,settle,1500.0,5000.0,"
    found = read_samples(run.path)
    assert found.simulated
    assert found.column("thrust_N")[2] == 0.1 + 0.2
    assert np.isnan(found.column("thrust_N")).tolist() == [False, True] * 2 + [False] + [
        False,
        True,
    ] * 2 + [False]
    assert set(found.column("phase")) == {
        word_to_code("phase", "settle"),
        word_to_code("phase", "sample"),
    }


def test_a_tare_is_no_point_unless_asked_for(tmp_path):
    run = small_run(tmp_path / "run")
    assert len(read_points(run.path)) == 4
    assert len(read_points(run.path, KINDS)) == 5
    assert len(read_points(run.path / "points.csv", ["reference"])) == 2
    with pytest.raises(FileFormatError, match="no point of kind anchor"):
        read_points(run.path, ["anchor"])
    with pytest.raises(UnknownChoice, match="known: anchor, failed, measure, reference, tare"):
        read_points(run.path, ["ancor"])


def test_settings_hold_means_over_repeats_and_paired_ratios(tmp_path):
    run = small_run(tmp_path / "run")
    run.close()
    found = read_settings(run.path)
    assert found.column("n_repeats").tolist() == [2.0, 2.0]
    measured = found.select(found.column("kind") == word_to_code("kind", "measure"))
    assert measured.column("thrust_N")[0] == pytest.approx(11.212)
    assert measured.column("thrust_sd_N")[0] == pytest.approx(0.424 / 2**0.5)
    assert measured.column("thrust_se_N")[0] == pytest.approx(0.212)
    # Paired within repeats: 11/10 and 11.424/10.2, not over the mean reference.
    assert measured.column("ratio_equal_pwm")[0] == pytest.approx((1.1 + 1.12) / 2)
    assert measured.column("ratio_equal_pwm_sd")[0] == pytest.approx(0.02 / 2**0.5)
    assert measured.column("ratio_equal_rpm2")[0] == pytest.approx((1.1 + 1.12) / 2)
    reference = found.select(found.column("kind") == word_to_code("kind", "reference"))
    assert np.isnan(reference.column("ratio_equal_pwm_sd")[0])


def test_parquet_is_preferred_and_checked(tmp_path):
    run = small_run(tmp_path / "run")
    from_csv = read_samples(run.path)
    run.close()
    from_parquet = read_samples(run.path)
    assert from_parquet.provenance["file"].endswith("samples.parquet")
    assert from_parquet.names == from_csv.names
    np.testing.assert_array_equal(from_parquet.values, from_csv.values)
    with open(run.path / "samples.parquet", "ab") as file:
        file.write(b"x")
    with pytest.warns(UserWarning, match=r"its hash differs from metadata\.json"):
        again = read_samples(run.path)
    assert again.provenance["file"].endswith("samples.csv")
    assert "hash" in again.provenance["repairs"]
    np.testing.assert_array_equal(again.values, from_csv.values)


@pytest.mark.parametrize("cut", range(1, 40))
def test_a_kill_at_any_byte_loses_no_whole_row(tmp_path, cut):
    run = small_run(tmp_path / "run")
    path = run.path / "samples.csv"
    whole = path.read_bytes()
    path.write_bytes(whole[:-cut])
    rows = whole[:-cut].count(b"\n") - 1
    assert len(read_samples(run.path)) == rows
    writer = run.sample_writer(CHANNELS)
    assert writer.fragment == whole[:-cut].rsplit(b"\n", 1)[1].decode()
    writer.append(2, "sample", np.array([9.0]), np.array([9e6]), np.array([[1.0, 2.0, 3.0]]))
    writer.close()
    after = read_samples(run.path)
    assert len(after) == rows + 1
    assert after.column("thrust_N")[-1] == 3.0


def test_a_cut_point_is_said_and_taken_back(tmp_path):
    run = small_run(tmp_path / "run")
    path = run.path / "points.csv"
    path.write_bytes(path.read_bytes()[:-5])
    found = read_points(run.path)
    assert len(found) == 3
    assert "cut short" in found.provenance["repairs"]
    writer = run.point_writer(1)
    writer.append(point(4, "measure", 1, 2, 11.0))
    writer.close()
    assert len(read_points(run.path)) == 4


def test_another_bench_cannot_go_on_with_a_run(tmp_path):
    run = small_run(tmp_path / "run")
    with pytest.raises(FileFormatError, match="columns differ from the channels"):
        run.sample_writer(CHANNELS[:2])
    with pytest.raises(FileFormatError, match="a run with 4 rotors"):
        run.point_writer(4)


def test_interrupted_visits_keep_their_rows(tmp_path):
    run = small_run(tmp_path / "run")
    before = read_samples(run.path)
    found = write_marked_samples(run.path / "samples.csv", frozenset())
    assert (found.rows, found.last_s) == (10, 0.045)
    install_marked_samples(run.path / "samples.csv")
    assert write_marked_samples(run.path / "samples.csv", frozenset()) == found
    assert not list(run.path.glob(".*"))
    after = read_samples(run.path)
    assert set(after.column("phase")) == {word_to_code("phase", "interrupted")}
    np.testing.assert_array_equal(after.column("thrust_N"), before.column("thrust_N"))


def test_events_survive_a_cut_line(tmp_path):
    run = small_run(tmp_path / "run")
    log = run.event_log()
    log.append(Event(1.0, "tare", "tared"))
    log.close()
    with open(run.path / "events.jsonl", "ab") as file:
        file.write(b'{"time_s": 2.0, "ev')
    events = read_events(run.path / "events.jsonl")
    assert [event.event for event in events] == ["tare"]
    assert events[0].wall.endswith("+00:00")
    with open(run.path / "events.jsonl", "ab") as file:
        file.write(b"x" * 9000)  # longer than what is appended behind it
    log = run.event_log()
    assert log.fragment.endswith("xx")
    log.append(Event(3.0, "end", "ended at 20 °C"))
    log.close()
    lines = (run.path / "events.jsonl").read_text("utf-8").splitlines()
    assert [json.loads(line)["event"] for line in lines] == ["tare", "end"]
    assert "20 °C" in lines[1]


@pytest.mark.parametrize("whole", ["", "a\n"])
@pytest.mark.parametrize("torn", ["", "b", "b" * 4095, "b" * 9001])
def test_a_torn_line_of_any_length_is_cut_off(tmp_path, whole, torn):
    path = tmp_path / "x"
    path.write_text(whole + torn)
    file = AppendFile(path)
    assert file.fragment == torn
    file.write(b"c\n")
    file.close()
    assert path.read_text() == whole + "c\n"


def test_a_drive_without_locks_locks_nothing(tmp_path, monkeypatch):
    fcntl = pytest.importorskip("fcntl")

    def refused(handle: int, how: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", refused)
    file = EventLog(tmp_path / "x")
    file.write(b"row\n")
    file.close()
    assert (tmp_path / "x").read_bytes() == b"row\n"


def test_a_disk_that_fills_up_keeps_whole_rows_and_the_rest_in_memory(tmp_path, monkeypatch):
    path, write = tmp_path / "x", os.write
    room = [12]

    def little(handle: int, data: bytes) -> int:
        if not room[0]:
            raise OSError(28, "No space left on device")
        written = write(handle, data[: min(7, room[0])])
        room[0] -= written
        return written

    file = AppendFile(path)
    file.write(b"first\n")
    monkeypatch.setattr(os, "write", little)
    with pytest.raises(OSError, match="No space"):
        file.write(b"second row\nand third\n")
    room[0] = 99
    file.write(b"fourth\n")  # not behind a row that is missing
    file.sync()
    assert path.read_bytes() == b"first\n"
    file.copy_to(tmp_path / "rest", whole=False)
    assert (tmp_path / "rest").read_bytes() == b"second row\nand third\nfourth\n"
    file.copy_to(tmp_path / "all", whole=True)
    assert (tmp_path / "all").read_bytes() == b"first\nsecond row\nand third\nfourth\n"
    assert file.is_in_place()
    path.rename(tmp_path / "moved")
    assert not file.is_in_place()
    path.symlink_to("moved")
    assert not file.is_in_place()
    path.unlink()
    (tmp_path / "moved").write_bytes(b"")
    (tmp_path / "moved").rename(path)
    file.close()
    file.close()
    assert not file.is_in_place()
    with pytest.raises(ValueError, match="is closed"):
        file.write(b"")


def test_the_hash_names_the_data(tmp_path):
    run = small_run(tmp_path / "run")
    before = data_hash(run.path)
    run.close()
    assert data_hash(run.path) == before
    writer = run.point_writer(1)
    writer.append(point(5, "measure", 1, 3, 11.0))
    writer.close()
    assert data_hash(run.path) != before
    with pytest.raises(FileFormatError, match="neither a file nor a run"):
        data_hash(tmp_path)


def test_metadata_that_is_no_json_is_reported(tmp_path):
    run = small_run(tmp_path / "run")
    (run.path / "metadata.json").write_text("{")
    with pytest.raises(FileFormatError, match="not valid JSON"):
        read_points(run.path)
    assert json.loads((small_run(tmp_path / "b").path / "metadata.json").read_text())["simulated"]


def test_numbers_that_json_has_not_become_null():
    given = {"a": float("nan"), 1: (np.float64("inf"), np.int64(2)), "b": [1.5, "x", True]}
    assert json_ready(given) == {"a": None, "1": [None, 2], "b": [1.5, "x", True]}


def test_frames_speak_words_and_units(tmp_path):
    table = to_frame(read_points(small_run(tmp_path / "run").path))
    assert table["kind"].tolist() == ["measure", "reference", "reference", "measure"]
    assert table.attrs["units"]["rpm1"] == "rpm"
    assert table.attrs["units"]["thrust_se_N"] == "N"


def test_a_plan_that_somebody_wrote_into_a_folder_is_left_alone(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "plan.toml").write_text("[plan]\n")
    with pytest.raises(WouldOverwrite):
        Run.create(tmp_path / "mine", "", {})
    assert (tmp_path / "mine" / "plan.toml").read_text() == "[plan]\n"


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such locks")
def test_a_line_that_another_process_is_writing_is_not_cut_back(tmp_path):
    path = tmp_path / "events.jsonl"
    log = EventLog(path)
    log.write(b'{"kind": "ta')
    with pytest.raises(InputError, match="is in use by another process"):
        EventLog(path)
    assert path.read_bytes() == b'{"kind": "ta'
    log.close()
    assert EventLog(path).fragment == '{"kind": "ta'
