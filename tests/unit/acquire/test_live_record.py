"""A live recording: what a hand turns becomes an ordinary run, ended safely."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import benchtool as bt
from benchtool.acquire.inputs import SweepInputs
from benchtool.acquire.live import LiveRecording, live_plan
from benchtool.acquire.record import RunProgress
from benchtool.acquire.resume import close_run, load_resume_state
from benchtool.bench.drivers import open_bench
from benchtool.bench.guard import GuardedBench
from benchtool.core.errors import InputError, RunInterrupted
from benchtool.core.rig_file import load_rig_by_name
from benchtool.data.columns import word_to_code
from benchtool.data.run.entry import build_entry
from benchtool.data.run.read import read_points, read_samples
from benchtool.data.run.run import Run, read_settings
from benchtool.data.run.runs_folder import RunsFolder

RIG = load_rig_by_name("pquad")


class Hand:
    """Turn all rotors at pulses until given times of the bench's clock."""

    def __init__(self, bench: GuardedBench, *levels: tuple[float, float]) -> None:
        self._bench, self._levels = bench, levels

    def turn(self) -> bool:
        now_s = self._bench.now_s()
        pulse_us = next((pulse_us for until_s, pulse_us in self._levels if now_s < until_s), None)
        if pulse_us is None:
            return False
        wanted = np.full(RIG.n_rotors, pulse_us)
        if not np.array_equal(wanted, self._bench.pwm_us):
            self._bench.set_pwm(wanted)
        return True


def live_recording(path: Path, turn: Callable[[], bool]) -> LiveRecording:
    inputs = SweepInputs(plan=live_plan("live", RIG), runs=path)
    return LiveRecording(inputs, RIG, RunProgress(), turn)


def recorded(path: Path, *levels: tuple[float, float]) -> tuple[Run, LiveRecording]:
    """Return the run of a simulated bench on which pulses were held until those times."""
    with GuardedBench(open_bench("sim:pquad?seed=4"), RIG) as bench:
        live = live_recording(path, Hand(bench, *levels).turn)
        run = live.create_run(bench.identity)
        try:
            live.record(bench, run)
            assert not bench.reason
        finally:
            assert (bench.pwm_us == RIG.propulsion.pwm_stop_us).all()
    run.close()
    return run, live


def test_levels_that_are_held_make_points_as_those_of_a_sweep(tmp_path):
    run, summary = recorded(tmp_path, (6.0, 1000.0), (22.0, 1400.0), (23.0, 1500.0), (34.0, 1600.0))
    samples, points = read_samples(run.path), read_points(run.path)
    assert len(samples) == summary.recorder.quality.samples
    assert summary.recorder.quality.lost == 0
    measured = points.select(points.column("kind") == word_to_code("kind", "reference"))
    pulses_us = measured.column("pwm1_us")
    assert set(pulses_us) == {1400.0, 1600.0}  # 1500 us were left before they had settled
    assert len(pulses_us) == summary.n_points >= 4
    assert list(measured.column("repeat")[pulses_us == 1400.0][:2]) == [1.0, 2.0]
    for row, pulse_us in enumerate(pulses_us):
        # Each is the mean of its own samples, which are those after the level had settled.
        own = samples.select(
            (samples.column("point") == measured.column("point")[row])
            & (samples.column("phase") == word_to_code("phase", "sample"))
        )
        assert np.ptp(own.column("pwm1_us")) == 0.0
        assert own.column("pwm1_us")[0] == pulse_us
        assert np.ptp(own.column("time_s")) == pytest.approx(2.0, abs=0.1)
        mean_N = float(np.nanmean(own.column("thrust_N")))
        assert measured.column("thrust_N")[row] == pytest.approx(mean_N, rel=2e-3)
    facts = run.metadata
    assert (facts["experiment"], facts["state"]) == ("live", "ended")
    with pytest.raises(InputError, match="is a live recording and cannot be resumed"):
        load_resume_state(run)
    entry = build_entry(RunsFolder(tmp_path), run.path.name)
    assert (entry.kind, entry.can_fit) == ("live recording", True)
    assert len(bt.runs(tmp_path, kind="live recording").query("FROM points")) == len(points) + 1
    assert read_settings(run.path).column("n_repeats").sum() == summary.n_points


def test_a_limit_ends_it_with_motors_at_zero_and_the_samples_on_the_disk(tmp_path):
    with pytest.raises(RunInterrupted):
        _stopped(tmp_path)
    (path,) = tmp_path.iterdir()
    run = Run.open(path)
    close_run(run)
    assert run.metadata["state"] == "stopped"
    assert "the hand failed" in run.metadata["reason"]
    pulses_us = read_samples(path).column("pwm1_us")
    assert pulses_us.max() == 1400.0
    assert pulses_us[-1] == RIG.propulsion.pwm_stop_us


def _stopped(path: Path) -> None:
    with GuardedBench(open_bench("sim:pquad"), RIG) as bench:
        hand = Hand(bench, (20.0, 1400.0))

        def turn() -> bool:
            if not hand.turn():
                raise RunInterrupted("the hand failed")
            return True

        live = live_recording(path, turn)
        live.record(bench, live.create_run(bench.identity))
