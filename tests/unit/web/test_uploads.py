"""Import of uploaded files, compared with `benchtool import` and `benchtool fit`."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchtool.commands.import_file import ImportInputs
from benchtool.core.errors import FileFormatError, InputError, WouldOverwrite
from benchtool.data.catalogue.index import list_entries
from benchtool.data.formats.formats import import_file
from benchtool.data.run.recording_file import read_recording
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.report.compare.page import compare_runs
from benchtool.report.page import Table
from benchtool.web.entries import (
    MOTOR_PART,
    export_file,
    stand_blocks,
    store_radius,
    store_upload,
    view_entry,
    view_part,
)
from benchtool.web.tabs.fit import FitRequest, build_fit_inputs

STAND = "rcbenchmark_1580/StepsTest_2020-05-22_102946.csv"
LOG = "logs/sample_log_small.ulg"


def uploaded(runs: Path, file: Path, **options: object) -> str:
    runs.mkdir(exist_ok=True)
    inputs = ImportInputs(files=(file,), **options)  # type: ignore[arg-type]
    return store_upload(runs, file.name, file.read_bytes(), "2026-01-02", inputs)


def test_a_stands_table_is_mapped_fitted_and_compared_without_a_word(tmp_path, reference_data):
    stand = reference_data / STAND
    runs = tmp_path / "runs"
    name = uploaded(runs, stand)
    assert (runs / name).read_bytes() == stand.read_bytes()
    rows = next(block for block in stand_blocks(runs / name) if isinstance(block, Table)).rows
    columns = {row[0]: row[1] for row in rows}
    assert columns["rpm1"].startswith("Motor Electrical Speed")
    assert columns["pwm1_us"].startswith("ESC signal")
    folder = RunsFolder(runs)
    entries = {entry.name: entry for entry in list_entries(folder)}
    request = FitRequest(data=[name], model="single", name="fit")
    with pytest.raises(InputError, match="does not say which rig"):
        build_fit_inputs(request, folder, entries)
    with pytest.raises(InputError, match="type one in m"):
        store_radius(runs, name, None)
    request.options["rig"] = str(store_radius(runs, name, 0.127))
    recipe = build_fit_inputs(request, folder, entries).recipe
    assert (recipe.columns, tuple(recipe.hold)) == (None, ("R_m",))
    with pytest.raises(WouldOverwrite):
        store_radius(runs, name, 0.2)
    (run,) = compare_runs([runs / name]).runs
    assert run.values("efficiency_N_W") is not None
    assert view_entry(runs, name)[1] == (MOTOR_PART,)
    assert "names no propeller" in view_part(runs, name, MOTOR_PART).html
    command = view_part(runs, name, MOTOR_PART, "5x4.5").command
    assert command == ("motor", str(runs / name), "--propeller", "5x4.5")
    assert export_file(runs, name, "ardupilot", "5x4.5")[1]


def test_options_and_logs_make_recordings(tmp_path, reference_data):
    stand = reference_data / STAND
    runs = tmp_path / "runs"
    name = uploaded(runs, stand, flip=("thrust_N",))
    thrust_N = import_file(stand).recording.column("thrust_N")
    assert read_recording(runs / name).column("thrust_N").tolist() == (-thrust_N).tolist()
    log = uploaded(runs, reference_data / LOG)
    kinds = {entry.name: entry.kind for entry in list_entries(RunsFolder(runs))}
    assert kinds == {name: "recording", log: "recording"}
    bad = tmp_path / "bad.ulg"
    bad.write_bytes(b"ULog\x01\x12\x35")
    with pytest.raises(FileFormatError):
        uploaded(runs, bad)
    assert len(list(runs.iterdir())) == 2
