from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchtool.acquire.calibration import fit_calibration, recalibrate
from benchtool.acquire.inputs import SweepInputs
from benchtool.acquire.plan import Plan, plan_from_toml
from benchtool.acquire.record import RunProgress
from benchtool.acquire.sweep import Sweep
from benchtool.acquire.visit_order import plan_visits
from benchtool.bench.guard import GuardedBench
from benchtool.bench.stage.stage import DeviceStage
from benchtool.core.errors import (
    BenchError,
    LinkLost,
    RunInterrupted,
    StandstillNotConfirmed,
    WouldOverwrite,
)
from benchtool.core.rig_file import load_rig_by_name
from benchtool.data.atomic import data_hash
from benchtool.data.calibration import Calibration
from benchtool.data.columns import KINDS, PHASES, word_to_code
from benchtool.data.run.append import read_events
from benchtool.data.run.points import Point
from benchtool.data.run.read import read_points, read_samples
from benchtool.data.run.run import Run
from tests.unit.acquire.fake_bench import FakeBench

RIG = load_rig_by_name("pquad_single")
SETTINGS = "plate.distances_m = [0.1, 0.2]\nthrottle.pwm_us = [1400.0]\norder.anchor_every = 2\n"
PLAN = plan_from_toml(f"repeats = 2\nsample_s = 0.5\n{SETTINGS}", "plan")


class Watcher(RunProgress):
    """Note what a sweep reports."""

    def __init__(self) -> None:
        self.points: list[Point] = []
        self.left_s: list[float] = []
        self.words: list[str] = []

    def started(self, visits: int, done: int, expected_s: float) -> None:
        self.words.append(f"{visits} {done}")

    def visiting(self, visit: object) -> None:
        pass

    def measured(self, point: Point, remaining_s: float) -> None:
        self.points.append(point)
        self.left_s.append(remaining_s)

    def happened(self, event: object) -> None:
        self.words.append(event.event)  # type: ignore[attr-defined]


def sweep(
    bench: FakeBench,
    path: Path,
    plan: Plan = PLAN,
    watcher: Watcher | None = None,
    calibration: Calibration | None = None,
) -> tuple[Sweep, Run]:
    measured = Sweep(SweepInputs(plan=plan.resolved(RIG), out=path, operator="me"), RIG)
    measured.calibration = calibration
    run = measured.create_run(bench.identity)
    with GuardedBench(bench, RIG) as guarded:
        measured.stage = DeviceStage(guarded)
        measured.record(guarded, run, watcher)
    return measured, run


def test_a_sweep_measures_every_visit_once(tmp_path):
    bench, watcher = FakeBench(), Watcher()
    summary, run = sweep(bench, tmp_path / "run", watcher=watcher)
    visits = plan_visits(PLAN.resolved(RIG), RIG)
    assert summary.n_measured == len(visits) == len(watcher.points)
    assert (watcher.words[0], "thrust" in watcher.words) == (f"{len(visits)} 0", False)
    assert max(watcher.left_s) == watcher.left_s[0]
    assert watcher.left_s[-1] == 0.0
    points = read_points(run.path)
    assert points.column("point").tolist() == [float(visit.point) for visit in visits]
    np.testing.assert_allclose(points.column("rpm1"), 4000.0, atol=1.0)
    np.testing.assert_allclose(points.column("thrust_N"), 1.6, atol=2e-3)
    assert run.metadata["state"] == "ended"
    assert run.metadata["operator"] == "me"
    assert run.metadata["air"]["measured"] is False
    assert run.metadata["link"]["samples"] == summary.recorder.quality.samples


def test_the_plate_moves_only_with_zero_commanded_and_the_end_ramps_down(tmp_path):
    bench = FakeBench()
    sweep(bench, tmp_path / "run")
    pulses: list[float] = []
    for what, value in bench.log:
        if what == "pwm":
            pulses.append(float(value))  # type: ignore[arg-type]
        if what in ("plate", "tare"):
            assert pulses[-1] == 1000.0
    end = pulses[-16:]
    assert end == sorted(end, reverse=True)
    assert 1000.0 < end[5] < 1400.0
    assert bench.log[-2:] == [("stop", None), ("close", None)]


def test_samples_of_points_are_those_of_the_phase(tmp_path):
    _, run = sweep(FakeBench(), tmp_path / "run")
    samples, points = read_samples(run.path), read_points(run.path)
    taken = samples.column("phase") == word_to_code("phase", "sample")
    for row in range(len(points)):
        chosen = taken & (samples.column("point") == points.column("point")[row])
        assert chosen.sum() == 50
        mean = samples.column("thrust_N")[chosen].mean()
        assert points.column("thrust_N")[row] == pytest.approx(mean, rel=1e-12)
    elapsed = points.column("time_s") - points.column("elapsed_s")
    tare = read_points(run.path, ["tare"])
    np.testing.assert_allclose(elapsed, tare.column("time_s")[0], atol=2e-6)


@pytest.mark.parametrize(
    "error",
    [LinkLost("the link is gone"), RunInterrupted("stopped by SIGTERM"), KeyboardInterrupt()],
    ids=lambda error: type(error).__name__,
)
def test_whatever_ends_it_zero_comes_first_and_the_reason_is_kept(tmp_path, error):
    bench = FakeBench()

    def fail() -> None:
        bench.log.append(("failed", None))
        raise error

    bench.at.append((12.0, fail))
    with pytest.raises(type(error)):
        sweep(bench, tmp_path / "run")
    words = [what for what, _ in bench.log]
    assert words[words.index("failed") + 1] == "stop"
    assert set(words[words.index("failed") + 1 : -1]) == {"stop"}
    assert words[-1] == "close"
    stopped = read_events(tmp_path / "run" / "events.jsonl")[-1]
    reason = str(error) or "stopped by Ctrl-C"
    assert (stopped.event, stopped.text) == ("stopped", reason)
    facts = Run.open(tmp_path / "run").metadata
    samples = read_samples(tmp_path / "run")
    tail = samples.column("phase") == word_to_code("phase", "end")
    # What waited in the link, then half a second at 100 Hz: nothing is missing.
    assert tail.sum() >= 50
    assert samples.column("pwm1_us")[-1] == 1000.0
    assert facts["link"]["samples"] == len(samples)
    np.testing.assert_allclose(np.diff(samples.column("time_s")), 0.01, atol=1e-6)
    assert (facts["state"], facts["reason"]) == ("stopped", reason)
    assert len(read_points(tmp_path / "run")) >= 1


def test_a_tare_that_leaves_too_much_is_refused(tmp_path):
    with pytest.raises(BenchError, match=r"\+0\.2 N after 3 tares, limit 0\.0502 N"):
        sweep(FakeBench(left_N=0.2), tmp_path / "run")
    events = [event.event for event in read_events(tmp_path / "run" / "events.jsonl")]
    assert events == ["plate", *["tare_residual"] * 3, "stopped"]


def test_a_rotor_that_turns_at_zero_is_refused(tmp_path):
    bench = FakeBench(idle_rpm=250.0)
    said = "MOTORS MAY STILL TURN: rpm1 250.*rpm1 still reads 250 rpm 10 s after zero"
    with pytest.raises(StandstillNotConfirmed, match=said):
        sweep(bench, tmp_path / "run")
    assert ("tare", None) not in bench.log


def test_a_thrust_that_creeps_is_taken_and_marked(tmp_path):
    bench = FakeBench()
    plan = replace(PLAN, settle=replace(PLAN.settle, timeout_s=2.0))

    def creep() -> None:
        bench.offset_N += 0.003
        bench.at.append((bench.now_s() + 0.1, creep))

    bench.at.append((3.0, creep))
    summary, run = sweep(bench, tmp_path / "run", plan)
    assert summary.n_unsettled == summary.n_measured
    assert not read_points(run.path).column("settled").any()
    events = read_events(run.path / "events.jsonl")
    assert sum(event.event == "settle_timeout" for event in events) == summary.n_measured


def test_an_anchor_that_has_drifted_asks_for_a_tare(tmp_path):
    bench = FakeBench()

    def drift() -> None:
        bench.offset_N += 0.1

    bench.at.append((8.0, drift))
    plan = replace(PLAN, tare=replace(PLAN.tare, drift_N=0.05))
    summary, run = sweep(bench, tmp_path / "run", plan)
    assert summary.n_tares == 2
    drifts = [e for e in read_events(run.path / "events.jsonl") if e.event == "drift"]
    assert len(drifts) == 1
    assert "anchor 2 has changed by +0.0999" in drifts[0].text
    assert len(read_points(run.path, ["tare"])) == 2


def test_a_tare_is_repeated_after_its_time(tmp_path):
    plan = replace(PLAN, tare=replace(PLAN.tare, every_minutes=0.2))
    summary, run = sweep(FakeBench(), tmp_path / "run", plan)
    assert summary.n_tares == 2
    assert 12.0 < read_points(run.path).column("elapsed_s").max() < 12.0 + 5.0


def test_a_hot_esc_rests_until_it_has_cooled(tmp_path):
    bench = FakeBench()

    def heat() -> None:
        bench.temperature_degC = 80.0
        bench.at.append((bench.now_s() + 30.0, cool))

    def cool() -> None:
        bench.temperature_degC = 30.0

    bench.at.append((8.0, heat))
    plan = replace(PLAN, rest=replace(PLAN.rest, above_degC=70.0))
    _, run = sweep(bench, tmp_path / "run", plan)
    events = {e.event: e for e in read_events(run.path / "events.jsonl")}
    assert "80.0 degC is above 70 degC" in events["rest"].text
    assert 25.0 < events["rested"].time_s - events["rest"].time_s < 35.0
    samples = read_samples(run.path)
    resting = samples.column("phase") == word_to_code("phase", "rest")
    assert samples.column("rpm1")[resting][-50:].max() == 0.0


COUNTS = fit_calibration(
    np.array([0.0, 0.1, 0.2]),
    5000.0 + 500.0 * 9.80665 * np.array([0.0, 0.1, 0.2]),
    date="2026-01-31",
    device_id="fake-1",
)


def test_a_run_is_recalibrated_beside_its_raw_data(tmp_path):
    _, plain = sweep(FakeBench(), tmp_path / "plain")
    _, scaled = sweep(FakeBench(), tmp_path / "scaled", calibration=COUNTS)
    before = data_hash(plain.path)
    again = recalibrate(plain, COUNTS)
    assert data_hash(plain.path) == before
    np.testing.assert_allclose(
        read_points(again, KINDS).column("thrust_N")[1:],
        read_points(scaled.path, KINDS).column("thrust_N")[1:],
        rtol=1e-12,
    )
    facts = Run.open(again).metadata
    assert facts["calibration"]["id"] == COUNTS.id
    assert facts["recalibrated_from"] == {"run": "plain", "sha256": before}
    assert read_points(again).provenance["calibration_relative_sd"] == str(COUNTS.relative_sd)
    assert facts["calibration_of_other_device"] is False
    with pytest.raises(WouldOverwrite):
        recalibrate(plain, COUNTS)


def test_a_pause_stands_between_two_visits_with_motors_at_zero(tmp_path):
    bench, watcher = FakeBench(), Watcher()
    asked: list[float] = []

    def waits() -> bool:
        asked.append(bench.now_s())
        return len(watcher.points) == 2 and len(asked) < 30

    watcher.is_paused = waits  # type: ignore[method-assign]
    summary, run = sweep(bench, tmp_path / "run", watcher=watcher)
    assert summary.n_measured == len(watcher.points) > 3
    between = watcher.words[watcher.words.index("paused") : watcher.words.index("went_on")]
    assert between == ["paused"]
    events = {event.event: event for event in read_events(run.path / "events.jsonl")}
    paused_s, on_s = events["paused"].time_s, events["went_on"].time_s
    assert on_s - paused_s > 1.0
    samples = read_samples(run.path)
    rows = (samples.column("time_s") > paused_s) & (samples.column("time_s") <= on_s)
    assert rows.sum() > 50
    assert set(samples.column("phase")[rows]) == {float(PHASES.index("rest"))}
    np.testing.assert_array_equal(samples.column("rpm1")[rows], 0.0)


def events_of(run: Run, kind: str) -> list[str]:
    return [item.text for item in read_events(run.path / "events.jsonl") if item.event == kind]


def test_missed_counts_are_left_out_and_their_number_stands_beside(tmp_path):
    bench = FakeBench()
    bench.shown_rpm = lambda time_s, rpm: np.where((time_s * 100.0).round() % 50, rpm, rpm / 2)
    summary, run = sweep(bench, tmp_path / "run")
    points, samples = read_points(run.path), read_samples(run.path)
    np.testing.assert_allclose(points.column("rpm1"), 4000.0, atol=1.5)
    assert set(points.column("rpm1_rejected")) == {1.0}
    assert not points.column("thrust_N_rejected").any()
    assert (summary.n_suspect, points.column("suspect").any()) == (0, False)
    said = events_of(run, "outliers")
    assert len(said) == summary.n_measured
    assert "1 of 50 samples of rpm1 (from " in said[0]
    assert "and are excluded from the mean" in said[0]
    taken = samples.column("rpm1")[samples.column("phase") == word_to_code("phase", "sample")]
    assert (taken < 2500.0).sum() == summary.n_measured  # raw samples stay


def test_a_rotor_that_hunts_marks_its_points(tmp_path):
    bench = FakeBench()
    bench.shown_rpm = lambda time_s, rpm: np.where((time_s * 100.0).round() % 10, rpm, 0.9 * rpm)
    summary, run = sweep(bench, tmp_path / "run")
    points = read_points(run.path)
    assert summary.n_suspect == summary.n_measured == len(points)
    assert points.column("suspect").all()
    np.testing.assert_allclose(points.column("rpm1"), 3960.0, atol=2.0)
    assert "none is excluded and the point is marked as suspect" in events_of(run, "suspect")[0]
    ended = read_events(run.path / "events.jsonl")[-1]
    assert ended.text.endswith(f"{summary.n_measured} of them suspect")


def test_a_speed_that_freezes_is_found_within_its_visit_and_measured_again(tmp_path):
    bench, begun_s = FakeBench(), 5.0
    bench.shown_rpm = lambda time_s, rpm: np.where(
        (time_s > begun_s) & (time_s < begun_s + 1.5), 4001.0, rpm
    )
    summary, run = sweep(bench, tmp_path / "run")
    (said,) = [text for text in events_of(run, "frozen") if "rpm1" in text]
    assert "rpm1 repeats 4001 for 1." in said
    assert said.endswith("measured again")
    found = next(e for e in read_events(run.path / "events.jsonl") if e.text == said)
    assert found.time_s < begun_s + 1.4  # while it runs, not at its end
    np.testing.assert_allclose(read_points(run.path).column("rpm1"), 4000.0, atol=1.0)
    assert summary.n_measured == len(read_points(run.path))


def test_a_speed_that_stays_frozen_fails_its_visits_and_the_run_says_so(tmp_path):
    bench = FakeBench()
    bench.shown_rpm = lambda time_s, rpm: np.full(rpm.shape, 4001.0)
    with pytest.raises(RunInterrupted, match=r"\(0 measured\): samples too few, late or frozen"):
        sweep(bench, tmp_path / "run")
    failed = read_points(tmp_path / "run", ["failed"])
    assert len(failed) == len(plan_visits(PLAN.resolved(RIG), RIG))
    samples = read_samples(tmp_path / "run")
    assert (samples.column("phase") == word_to_code("phase", "settle")).any()


def test_a_calibration_is_attached_and_raw_data_stay(tmp_path):
    _, plain = sweep(FakeBench(), tmp_path / "plain")
    _, scaled = sweep(FakeBench(), tmp_path / "scaled", PLAN, watcher := Watcher(), COUNTS)
    assert watcher.words.count("thrust") == 1  # 3.2 N, expected 1.4 N
    assert (plain.path / "samples.csv").read_bytes() == (scaled.path / "samples.csv").read_bytes()
    # The device counts 1000 per N, the calibration says 500.
    np.testing.assert_allclose(read_points(scaled.path).column("thrust_N"), 3.2, atol=4e-3)
