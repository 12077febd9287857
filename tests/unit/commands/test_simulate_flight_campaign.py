"""`benchtool simulate flight --vary`: the table, the means, and what is refused."""

from __future__ import annotations

from functools import partial

import pandas as pd
import pyarrow.parquet as pq

from tests.unit.commands import command_line

run = partial(command_line.run, "simulate", "flight")


def test_which_gains_cross_at_which_speed(tmp_path, capsys):
    out = tmp_path / "crossing"
    assert run(
        "--vary", "speed=0.2:0.8:2", "--vary", "gains.attitude=1.0:1.6:2", "--seeds", "2",
        "--gains", "s3", "--gains", "stiff", "--duration-s", "60", "--out", str(out),
    ) == 0  # fmt: skip
    said = capsys.readouterr().out.splitlines()
    assert said[4:8] == [
        "  s3, oge: 1", "  s3, pid: 0.75", "  stiff, oge: 1", "  stiff, pid: 1",
    ]  # fmt: skip
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
