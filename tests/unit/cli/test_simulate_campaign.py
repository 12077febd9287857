"""Campaigns: the design, the table on disk, the map, and memory that does not grow."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from benchtool.cli.app import main
from benchtool.errors import InputError
from benchtool.store.campaign import read_campaign
from benchtool.studies.campaign import Vary, design, design_size, run_campaign, write_campaign
from benchtool.studies.pitch_setup import PitchSetup, changed, pitch_setup

WORDS = ("simulate", "pitch", "--duration-s", "12", "--controllers", "pid,observer")


def short(duration_s: float = 12.0) -> PitchSetup:
    from dataclasses import replace

    setup = pitch_setup(controllers=("pid",))
    return replace(setup, schedule=setup.schedule.lasting(duration_s))


def test_a_grid_and_a_random_design() -> None:
    varied = [Vary.read("K_b=1.5:2.5:3"), Vary.read("gains.attitude=0.8:1.2:2")]
    points = list(design(varied, 0, 1))
    assert len(points) == design_size(varied, 0) == 6
    assert points[1] == {"K_b": 1.5, "gains.attitude": 1.2}
    random = list(design(varied, 50, 1))
    assert len(random) == 50
    assert random == list(design(varied, 50, 1))
    assert all(1.5 <= point["K_b"] <= 2.5 for point in random)


@pytest.mark.parametrize(
    "text", ["K_b", "K_b=1:2", "K_b=1:2:0", "K_b=a:2:3", "=1:2:3", "K=1:nan:3"]
)
def test_a_range_that_cannot_be_read_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="write NAME=FROM:TO:COUNT"):
        Vary.read(text)


def test_every_point_sees_the_same_noise_and_stands_as_if_run_alone() -> None:
    setup = short()
    varied = [Vary.read("bench.inertia_kgm2=0.015:0.021:3")]
    rows = list(run_campaign(setup, lambda: design(varied, 0, 0), seeds=2, seed=5))
    assert [row["seed"] for row in rows] == [5.0, 6.0] * 3
    one = changed(setup, {"bench.inertia_kgm2": 0.018})
    alone = list(run_campaign(one, lambda: iter([{}]), seeds=2, seed=5))
    for mine, other in zip(rows[2:4], alone, strict=True):
        assert mine["rms_deg"] == pytest.approx(float(other["rms_deg"]), rel=1e-9)
    assert rows[0]["rms_deg"] != rows[1]["rms_deg"]


def test_the_command_writes_a_tidy_table_and_a_map(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out = tmp_path / "campaign"
    vary = ("--vary", "gains.attitude=0.8:1.2:2", "--vary", "K_b=1.5:2.5:3", "--seeds", "2")
    with pytest.raises(SystemExit) as left:
        main([*WORDS, *vary, "--out", str(out)])
    assert left.value.code == 0
    assert "24 runs in" in capsys.readouterr().out
    table = read_campaign(
        out / "campaign.parquet", ["gains.attitude", "K_b", "controller", "seed", "peak_deg"]
    )
    assert {len(column) for column in table.values()} == {24}
    pid = table["controller"] == "pid"
    soft = pid & (table["gains.attitude"] == 0.8)
    stiff = pid & (table["gains.attitude"] == 1.2)
    assert np.abs(table["peak_deg"][soft]).mean() > 1.3 * np.abs(table["peak_deg"][stiff]).mean()
    svg = (out / "campaign.svg").read_text(encoding="utf-8")
    assert "simulated-stamp" in svg
    assert sorted(path.name for path in out.iterdir()) == [
        "campaign.parquet", "campaign.png", "campaign.svg",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--vary", "K_b=1:2:3"), "add --out FOLDER"),
        (("--vary", "K_b=1:2:3", "--vary", "K_b=1:2:3", "--out", "x"), "one number twice"),
        (("--vary", "Kb=1:2:3", "--out", "x"), "unknown number to set or vary"),
        (("--vary", "gains.control_rate_Hz=250:500:2", "--out", "x"), "cannot vary control_rate"),
    ],
)
def test_a_campaign_that_cannot_be_run_is_refused(
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as left:
        main([*WORDS, *words])
    assert left.value.code == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.rglob("*.parquet"))


def test_memory_does_not_grow_with_the_number_of_runs(tmp_path: Path) -> None:
    row = {"K_b": 1.0, "controller": "pid", "rms_deg": 0.5}

    def peak_of(count: int) -> int:
        def rows() -> Iterator[dict[str, float | str]]:
            for _ in range(count):
                yield dict(row)

        tracemalloc.start()
        write_campaign(rows(), tmp_path / f"{count}.parquet", {}, lambda _: None)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak

    peak_of(10)
    assert peak_of(80_000) < 1.3 * peak_of(10_000)
