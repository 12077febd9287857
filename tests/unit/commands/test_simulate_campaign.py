"""Campaigns: design, table file, and constant memory."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from benchtool.core.errors import WouldOverwrite
from benchtool.data.parquet import write_campaign
from benchtool.simulate.campaign import Campaign, Design
from benchtool.simulate.inputs import PitchInputs, Row
from benchtool.simulate.pitch.setup import PitchSetup, pitch_setup
from tests.unit.commands import command_line
from tests.unit.commands.command_line import said

ARGUMENTS = ("simulate", "pitch", "--duration-s", "12", "--controllers", "pid,observer")


def short() -> PitchSetup:
    setup = pitch_setup(PitchInputs(controllers=("pid",)))
    return replace(setup, schedule=setup.schedule.with_duration(12.0))


def test_every_point_has_the_same_noise_as_a_single_run():
    setup = short()
    design = Design.read(["bench.inertia_kgm2=0.015:0.021:3"], seeds=2, seed=5)
    rows = list(Campaign({"s3": setup}, ("pid",)).rows(design))
    assert [row["seed"] for row in rows] == [5.0, 6.0] * 3
    single_design = Design.read(["bench.inertia_kgm2=0.018:0.018:1"], seeds=2, seed=5)
    single_rows = list(Campaign({"s3": setup}, ("pid",)).rows(single_design))
    for row, single_row in zip(rows[2:4], single_rows, strict=True):
        assert row["rms_deg"] == pytest.approx(float(single_row["rms_deg"]), rel=1e-9)
    assert rows[0]["rms_deg"] != rows[1]["rms_deg"]


def test_the_command_writes_a_tidy_table(capsys, tmp_path):
    out = tmp_path / "campaign"
    vary = ("--vary", "gains.attitude=0.8:1.2:2", "--vary", "K_b=1.5:2.5:3", "--seeds", "2")
    code, output, _ = said(capsys, *ARGUMENTS, *vary, "--out", out)
    assert code == 0
    assert "24 runs in" in output
    table = pd.read_parquet(out / "campaign.parquet")
    assert len(table) == 24
    pid = table["controller"] == "pid"
    soft = pid & (table["gains.attitude"] == 0.8)
    stiff = pid & (table["gains.attitude"] == 1.2)
    assert np.abs(table["peak_deg"][soft]).mean() > 1.3 * np.abs(table["peak_deg"][stiff]).mean()
    assert [path.name for path in out.iterdir()] == ["campaign.parquet"]


def test_a_table_is_written_atomically_and_not_overwritten(tmp_path):
    path = tmp_path / "campaign.parquet"

    def rows() -> Iterator[Row]:
        yield from ({"K_b": float(number)} for number in range(10))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_campaign(rows(), path, {})
    assert not path.exists()
    assert write_campaign([{"K_b": 1.0}], path, {}) == 1
    with pytest.raises(WouldOverwrite, match=r"campaign\.parquet exists already"):
        write_campaign([{"K_b": 2.0}], path, {})
    assert pd.read_parquet(path)["K_b"].tolist() == [1.0]


def test_memory_does_not_grow_with_the_number_of_runs(tmp_path):
    row = {"K_b": 1.0, "controller": "pid", "rms_deg": 0.5}

    def measure_peak(count: int) -> int:
        def rows() -> Iterator[dict[str, float | str]]:
            for _ in range(count):
                yield dict(row)

        tracemalloc.start()
        write_campaign(rows(), tmp_path / f"{count}.parquet", {})
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak

    measure_peak(10)
    assert measure_peak(80_000) < 1.3 * measure_peak(10_000)


run = partial(command_line.run, "simulate", "flight")


def test_a_flight_campaign_over_speed_and_gains(tmp_path, capsys):
    out = tmp_path / "crossing"
    assert run(
        "--vary", "speed=0.2:0.8:2", "--vary", "gains.attitude=1.0:1.6:2", "--seeds", "2",
        "--gains", "s3", "--gains", "stiff", "--duration-s", "60", "--out", str(out),
    ) == 0  # fmt: skip
    lines = capsys.readouterr().out.splitlines()
    assert lines[4:8] == [
        "  s3, oge: 1", "  s3, pid: 0.75", "  stiff, oge: 1", "  stiff, pid: 1",
    ]  # fmt: skip
    assert [path.name for path in out.iterdir()] == ["campaign.parquet"]
    names = ["speed_m_s", "gains.attitude", "gains", "controller", "seed", "arrives", "ending"]
    table = pd.read_parquet(out / "campaign.parquet")
    is_missed = table["arrives"] == 0.0
    assert set(table["seed"][is_missed]) == {1.0, 2.0}
    for name, value in zip(names[:4], (0.2, 1.0, "s3", "pid"), strict=True):
        assert set(table[name][is_missed]) == {value}
    assert set(table["ending"]) == {"flown"}
    metadata = {
        key.decode(): value.decode()
        for key, value in pq.read_schema(out / "campaign.parquet").metadata.items()
    }
    assert metadata["simulated"] == "true"
    assert (metadata["gyro_noise_rad_s"], metadata["vary.speed_m_s"]) == ("0.015", "0.2:0.8:2")
    assert run("--vary", "K_b=1:2:2", "--out", str(out)) == 2
    assert "exists already" in capsys.readouterr().err
