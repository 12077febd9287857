"""Command `benchtool import`: files, output and errors."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from benchtool.core.errors import FileFormatError, WouldOverwrite
from benchtool.core.recording import Recording
from benchtool.data.columns import find_channel
from benchtool.data.formats.formats import import_file
from benchtool.data.run.recording_file import read_recording, write_recording
from tests.unit.commands import command_line
from tests.unit.data.stand_logs import log_text, steps_1580

run = partial(command_line.run, "import")


@pytest.fixture
def log(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "steps.csv"
    thrust = steps_1580()["Thrust (gf)"] - 40.0
    thrust[3] = np.nan
    path.write_text(log_text(steps_1580(**{"Thrust (gf)": thrust})))
    return path


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_written_recording_reads_back(log, ending):
    assert run(log, "--out", f"out/steps.{ending}", "--tare", "thrust_N") == 0
    recording = read_recording(f"out/steps.{ending}")
    expected = import_file(log).recording
    assert recording.names == expected.names
    assert [item.unit for item in recording.channels] == [item.unit for item in expected.channels]
    np.testing.assert_array_equal(recording.column("rpm1"), expected.column("rpm1"))
    assert np.isnan(recording.column("thrust_N")[3])
    assert recording.column("thrust_N")[0] == 0.0
    assert recording.provenance["device"] == "RCbenchmark Series 1580/1585"
    metadata = json.loads(Path(f"out/steps.{ending}.json").read_text("utf-8"))
    assert metadata["tally"] == {
        "unit": "row", "total": 20, "kept": 20, "refused": 0, "not_needed": 0,
    }  # fmt: skip
    assert {item["what"] for item in metadata["findings"]} >= {"untared", "blank cells"}
    assert metadata["sources"]["thrust_N"] == "Thrust (gf)"
    assert metadata["options"] == {"tare": "('thrust_N',)"}


def test_files_are_overwritten_only_on_request(log, capsys):
    assert run(log) == 0
    before = Path("imported/steps.csv").read_bytes()
    repair = f"benchtool import {log} --tare thrust_N --overwrite\nnext: benchtool motor imported"
    assert repair in capsys.readouterr().out
    assert run(log, "--flip", "thrust_N") == 2
    assert Path("imported/steps.csv").read_bytes() == before
    assert "choose another name, or replace it with --overwrite" in capsys.readouterr().err
    assert run(log, "--flip", "thrust_N", "--overwrite") == 0
    assert Path("imported/steps.csv").read_bytes() != before


def test_two_files_with_one_target_are_rejected(log):
    Path("other").mkdir()
    Path("other/steps.csv").write_bytes(log.read_bytes())
    assert run(log, "other/steps.csv") == 2
    assert run(log, "other/steps.csv", "--out", "one.csv") == 2
    assert not Path("imported").exists()


def test_a_foreign_file_gives_the_terminal_no_orders(log, capsys):
    log.write_text(log_text(steps_1580()).replace("App message", "\x1b[31mred[/b]"))
    assert run(log, "--dry-run") == 0
    output = capsys.readouterr().out
    assert "\x1b" not in output
    assert "[31mred" in output
    log.write_text("\x1b[31mred,blue\n1,2\n")
    assert run(log, "--dry-run") == 2
    assert "\x1b" not in capsys.readouterr().err


def test_a_changed_recording_is_rejected(log):
    recording = Recording(
        (find_channel("thrust_N"), find_channel("rpm1")),
        np.array([[1.5, np.nan], [np.nan, np.nan], [np.nan, 2.5]]),
    )
    target = log.with_name("mine.csv")
    write_recording(target, recording, {})
    with pytest.raises(WouldOverwrite):
        write_recording(target, recording, {})
    np.testing.assert_array_equal(read_recording(target).values, recording.values)
    target.write_text(target.read_text() + "7\n")
    with pytest.raises(FileFormatError, match="has changed since"):
        read_recording(target)
    with pytest.raises(FileFormatError, match=r"allowed: \.csv, \.parquet"):
        write_recording(log.with_name("mine.xls"), recording, {})
