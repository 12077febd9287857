"""A point without its samples is measured again, and never called settled."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchtool.data.run.append import read_events
from tests.faults.loop import ADDRESS, World, command, plan, sweep
from tests.faults.proxy import Fault


@pytest.mark.parametrize("sample_s", [2.0, 4.0])
def test_a_span_that_lost_its_samples_is_measured_again(tmp_path: Path, sample_s: float) -> None:
    fault = Fault("drop", way="host", only="samples", for_s=0.85)
    outcome = sweep(tmp_path, plan(sample_s=sample_s), [fault])
    assert fault.hit > 100
    assert outcome.code == 0, outcome.said
    assert "samples of thrust_N came, at least 80 % are needed" in outcome.said
    assert "measured again" in outcome.said
    (point,) = outcome.points()
    assert float(point["n_samples"]) > 0.8 * 80.0 * sample_s
    assert (point["kind"], point["settled"]) == ("measure", "1")


def test_a_visit_that_fails_is_marked_and_measured_on_resuming(tmp_path: Path) -> None:
    # Four samples in five are lost while the plan's one point is held.
    fault = Fault("drop", way="host", only="samples", p=0.8, after_s=-0.2, seed=3)
    outcome = sweep(tmp_path, plan(), [fault])
    assert fault.hit > 100
    assert outcome.code == 5
    assert "1 visit failed for want of samples, 0 are measured" in outcome.said
    (point,) = outcome.points()
    assert (point["kind"], point["settled"]) == ("failed", "0")
    said = [
        e.text for e in read_events(tmp_path / "run" / "events.jsonl") if e.event == "few_samples"
    ]
    assert [text.rsplit("; ", 1)[1] for text in said] == [
        "measured again",
        "measured again",
        "marked as failed",
    ]
    assert outcome.metadata["state"] == "stopped"

    again = command(["sweep", ADDRESS, "--resume", "run", "--yes"], tmp_path, World([]))
    assert again.code == 0, again.said
    assert [point["kind"] for point in again.points()] == ["failed", "measure"]
    assert again.points()[1]["settled"] == "1"
    assert again.metadata["state"] == "ended"
