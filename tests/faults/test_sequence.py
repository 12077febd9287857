"""Samples that come twice, out of order, or not at all: each row once, and the right counts."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.acquire import resume
from benchtool.bench.serial.bench import SerialBench
from benchtool.data.run.append import read_events
from benchtool.data.run.run import Run
from tests.faults.loop import ADDRESS, World, command, plan, sweep
from tests.faults.proxy import Fault


@pytest.mark.parametrize(
    ("fault", "repeated"),
    [
        (Fault("duplicate", way="host", only="samples", for_s=1.0), True),
        (Fault("reorder", way="host", only="samples", for_s=1.0), False),
        (Fault("reorder", way="host", only="samples", times=2), False),
    ],
    ids=["twice", "pairs reversed", "one pair reversed"],
)
def test_twice_or_exchanged(tmp_path, fault, repeated):
    outcome = sweep(tmp_path, plan("1.36", 4.0), [fault])
    assert fault.hit >= 2
    assert outcome.code == 0, outcome.said
    times_us = [int(float(t)) for row in outcome.rows() if (t := row["device_time_us"])]
    assert len(times_us) == len(set(times_us))
    assert times_us == sorted(times_us)
    assert set(times_us) <= set(outcome.seen.rows)
    assert max(np.diff(times_us)) < 100_000
    link = outcome.metadata["link"]
    assert (link["lost"], link["repeated"] > 0) == (0, repeated)
    if repeated:  # all but those that the host did not read any more
        assert link["repeated"] == pytest.approx(fault.hit, abs=20)


def test_samples_that_are_lost_are_counted_one_by_one(tmp_path):
    lost = Fault("drop", way="host", only="samples", p=0.1, seed=2)
    outcome = sweep(tmp_path, plan("1.36", 4.0), [lost])
    assert lost.hit > 50
    assert outcome.code == 0, outcome.said
    assert outcome.metadata["link"]["lost"] == pytest.approx(lost.hit, abs=3)


def test_a_sweep_without_faults(tmp_path):
    outcome = sweep(tmp_path, plan(), [])
    assert (outcome.code, outcome.metadata["state"]) == (0, "ended"), outcome.said
    assert [point["settled"] for point in outcome.points()] == ["1"]
    assert max(us for _, us in outcome.pulses) == 1500.0
    phases = list(outcome.seen.phases)
    assert phases[:3] == ["connect", "hello", "arming"]
    assert phases[-4:] == ["ramping", "sampling", "stopping", "closing"]
    # Every row of the run is one that the device sent.
    for row in outcome.rows():
        assert int(float(row["device_time_us"])) in outcome.seen.rows


@pytest.mark.parametrize("sample_s", [2.0, 4.0])
def test_a_span_that_lost_its_samples_is_measured_again(tmp_path, sample_s):
    fault = Fault("drop", way="host", only="samples", for_s=0.85)
    outcome = sweep(tmp_path, plan(sample_s=sample_s), [fault])
    assert fault.hit > 100
    assert outcome.code == 0, outcome.said
    assert "samples of thrust_N received, minimum 80 %" in outcome.said
    assert "measured again" in outcome.said
    (point,) = outcome.points()
    assert float(point["n_samples"]) > 0.8 * 80.0 * sample_s
    assert (point["kind"], point["settled"]) == ("measure", "1")


def test_a_visit_that_fails_is_marked_and_measured_on_resuming(tmp_path):
    # Four samples in five are lost while the plan's one point is held.
    fault = Fault("drop", way="host", only="samples", p=0.8, after_s=-0.2, seed=3)
    outcome = sweep(tmp_path, plan(), [fault])
    assert fault.hit > 100
    assert outcome.code == 5
    assert "1 visit failed (0 measured): samples too few, late or frozen" in outcome.said
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


def test_a_run_is_read_before_its_bench_is_opened(tmp_path, monkeypatch):
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

    noted(Run, "prepare_samples", "samples read")
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
