"""`benchtool simulate flight --vary`: the table, the means, and what is refused."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from tests.unit.commands import command_line

run = partial(command_line.run, "simulate", "flight")


def test_which_gains_cross_at_which_speed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "crossing"
    assert run(
        "--vary", "speed=0.2:0.8:2", "--vary", "gains.attitude=1.0:1.6:2", "--seeds", "2",
        "--gains", "s3", "--gains", "stiff", "--duration-s", "60", "--out", str(out),
    ) == 0  # fmt: skip
    said = capsys.readouterr().out.splitlines()
    assert said[0] == (
        "SIMULATED campaign: Flying over an obstacle (case 1), pquad; 2 speed_m_s x "
        "2 gains.attitude, 2 seeds; 32 runs"
    )
    assert said[3:8] == [
        "share of flights that arrive, mean of all:",
        "  s3, oge: 1",
        "  s3, pid: 0.75",
        "  stiff, oge: 1",
        "  stiff, pid: 1",
    ]
    assert [path.name for path in out.iterdir()] == ["campaign.parquet"]
    names = ["speed_m_s", "gains.attitude", "gains", "controller", "seed", "arrives", "ending"]
    table = pd.read_parquet(out / "campaign.parquet")
    never = table["arrives"] == 0.0
    assert set(table["seed"][never]) == {1.0, 2.0}
    for name, value in zip(names[:4], (0.2, 1.0, "s3", "pid"), strict=True):
        assert set(table[name][never]) == {value}
    assert set(table["ending"]) == {"flown"}
    told = {
        key.decode(): value.decode()
        for key, value in pq.read_schema(out / "campaign.parquet").metadata.items()
    }
    assert told["simulated"] == "true"
    assert (told["gyro_noise_rad_s"], told["vary.speed_m_s"]) == ("0.015", "0.2:0.8:2")
    assert run("--vary", "K_b=1:2:2", "--out", str(out)) == 2
    assert "exists already" in capsys.readouterr().err


def test_a_random_design_of_another_measure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(
        "--case", "plate", "--duration-s", "14", "--vary", "z_over_R=1:3:2", "--samples", "12",
        "--controllers", "pid", "--measure", "max_pitch_deg", "--out", str(tmp_path),
    ) == 0  # fmt: skip
    assert "largest pitch [deg], mean of all:" in capsys.readouterr().out
    table = pd.read_parquet(tmp_path / "campaign.parquet")
    assert len(set(table["z_over_R"])) == 12
    assert np.corrcoef(table["z_over_R"], table["max_pitch_deg"])[0, 1] < -0.8


def test_a_point_of_a_campaign_can_be_flown_alone(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--set", "speed=0.5", "--set", "z_over_R=3", "--set", "gains.attitude=1.4")
    assert run("--controllers", "pid", *words) == 0
    assert "z/R 3, 0.5 m/s" in capsys.readouterr().out
