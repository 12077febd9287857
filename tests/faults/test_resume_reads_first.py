"""Going on with a run reads it before the bench is opened, which then waits for nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchtool.acquire import resume
from benchtool.bench.serial.bench import SerialBench
from benchtool.data.run.run import Run
from tests.faults.loop import ADDRESS, World, command, plan, sweep


def test_a_run_is_read_before_its_bench_is_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sweep(tmp_path, plan("1.36, 1.34", 0.5), [])
    points = tmp_path / "run/points.csv"
    points.write_text("\n".join(points.read_text().split("\n")[:3]) + "\n")
    order: list[str] = []

    def noted(where: object, name: str, what: str) -> None:
        real = getattr(where, name)

        def call(*words: object, **named: object) -> object:
            order.append(what)
            return real(*words, **named)

        monkeypatch.setattr(where, name, call)

    noted(Run, "ready_samples", "samples read")
    noted(resume, "read_points", "points read")
    noted(SerialBench, "open", "opened")
    noted(SerialBench, "set_pwm", "turning")
    resumed = command(["sweep", ADDRESS, "--resume", "run", "--yes"], tmp_path, World([]))
    assert resumed.code == 0, resumed.said
    assert len(resumed.points()) == 2
    assert "samples read" in order
    assert set(order[: order.index("opened")]) == {"points read", "samples read"}
    assert set(order[order.index("opened") :]) == {"opened", "turning"}
    # The visit that had no point is marked, and measured again.
    phases = [row["phase"] for row in resumed.rows() if row["point"] == "2"]
    assert phases[0] == "interrupted"
    assert phases[-1] == "sample"
