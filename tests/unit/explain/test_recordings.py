"""Recordings of an explanation: read whatever wrote them, refused with one sentence."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchtool.core.channel import Channel
from benchtool.core.errors import BenchtoolError
from benchtool.core.recording import Recording
from benchtool.data.run.recording_file import write_recording
from benchtool.explain.inputs import ExplainInputs
from benchtool.explain.request import bench_kind, read_request, read_sources
from benchtool.physics.model_file import LoadedModel, load_model
from tests.unit.explain.hand_made import MODEL

THEIRS = "t,theta_ref,theta,gyro,pwm1,pwm2,rpm1,rpm2,plate_z"


def csv(folder: Path, name: str, header: str = THEIRS, first: float = 0.0) -> str:
    columns = header.split(",")
    rows = [
        ",".join(f"{first + row + 0.1 * place:g}" for place in range(len(columns)))
        for row in range(5)
    ]
    path = folder / name
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return str(path)


def loaded() -> LoadedModel:
    return load_model(MODEL)


def test_a_csv_is_read_through_the_columns_of_the_model(tmp_path):
    learn, check = read_sources(
        [csv(tmp_path, "a.csv")], [csv(tmp_path, "b.csv", first=1.0)], loaded()
    )
    assert learn[0].name == "a.csv"
    assert bench_kind(learn[0]) == "pitch"
    assert learn[0].recording.column("pwm1_us")[0] == 0.4
    assert len(learn[0].sha256) == 64
    assert learn[0].sha256 != check[0].sha256
    assert learn[0].remarks == ()


def test_a_missing_column_is_told_and_the_rest_is_read(tmp_path):
    header = "t,theta_ref,theta,gyro,pwm1,pwm2,plate_z"
    (source,), _ = read_sources(
        [csv(tmp_path, "a.csv", header)], [csv(tmp_path, "b.csv")], loaded()
    )
    assert "rpm1" not in source.recording
    assert source.remarks == (
        "a.csv: no column 'rpm1', which the model's [columns] map to rpm1",
        "a.csv: no column 'rpm2', which the model's [columns] map to rpm2",
    )


def test_an_imported_recording_says_whether_it_is_simulated(tmp_path):
    recording = Recording.from_columns(
        [(Channel("time_s", "s"), np.arange(3.0)), (Channel("theta_rad", "rad"), np.zeros(3))],
        simulated=True,
    )
    write_recording(tmp_path / "a.parquet", recording, {})
    write_recording(tmp_path / "b.csv", replace(recording, simulated=False), {})
    (first,), (second,) = read_sources(
        [str(tmp_path / "a.parquet")], [str(tmp_path / "b.csv")], loaded()
    )
    assert first.recording.simulated
    assert not second.recording.simulated


def test_a_dead_channel_is_left_out_and_told(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(
        "time_s,theta_rad,rpm1,rpm2,pwm1_us,pwm2_us\n"
        "0,0.1,0,5000,1500,1500\n1,0.2,0,6100,1500,1500\n",
        encoding="utf-8",
    )
    (source,), _ = read_sources([str(path)], [csv(tmp_path, "b.csv")], loaded())
    assert source.recording.names == ("time_s", "theta_rad", "rpm2", "pwm1_us")
    assert [line.split(": ", 1)[1] for line in source.remarks] == [
        "rpm1 is 0 in every row: dead channel, not used; repair it",
        "pwm1_us is 1500 in every row, accepted as constant",
        "pwm2_us is 1500 in every row: dead channel, not used; repair it",
    ]


def test_a_recording_that_nothing_drove_is_refused_at_once(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(
        "time_s,theta_rad,rpm1,pwm1_us,pwm2_us\n0,0.1,0,1500,1500\n1,0.2,0,1500,1500\n",
        encoding="utf-8",
    )
    with pytest.raises(BenchtoolError, match=r"pwm1_us of a.csv is 1500 in every row, as are all"):
        read_sources([str(path)], [csv(tmp_path, "b.csv")], loaded())


@pytest.mark.parametrize(
    ("learn", "check", "said"),
    [
        ("", "a.csv", "no training recordings"),
        ("a.csv", "", "no validation recording"),
        ("a.csv", "a.csv", "same data"),
        ("a.csv", "copy.csv", "same data"),
        ("nowhere.csv", "a.csv", "no such run or file"),
        (".", "a.csv", "this folder is not a run; .*: a.csv, copy.csv"),
        ("m.toml", "a.csv", "m.toml: this is a TOML file"),
        ("word.csv", "a.csv", "it contains 'hello' and no row below"),
        ("bare.parquet", "a.csv", "bare.parquet.json is missing"),
        ("other.csv", "a.csv", r"of model.toml names 't', .*which other.csv lacks; .* a, b, c$"),
        ("notime.csv", "a.csv", "neither theta_rad .* nor thrust_N"),
        ("a.csv", "swept.csv", "a.csv is from a pitch bench, .* plate sweep"),
    ],
)
def test_what_cannot_be_explained_is_refused_with_the_reason(
    tmp_path, monkeypatch, learn, check, said
):
    monkeypatch.chdir(tmp_path)
    csv(tmp_path, "a.csv")
    csv(tmp_path, "copy.csv")
    csv(tmp_path, "other.csv", "a,b,c")
    csv(tmp_path, "notime.csv", "time_s,gyro_rad_s")
    csv(tmp_path, "swept.csv", "time_s,thrust_N")
    files = {
        "bare.parquet": "PAR1",
        "m.toml": "[model]\n",
        "word.csv": "hello\n",
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text, "utf-8")
    recordings, checks = tuple(learn.split()), tuple(check.split())
    with pytest.raises(BenchtoolError, match=said) as refused:
        read_request(ExplainInputs(recordings=recordings, check=checks, model=str(MODEL)))
    assert refused.value.exit_code == 2
    assert "\n" not in str(refused.value)
