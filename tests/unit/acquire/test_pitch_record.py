"""A pitch experiment from a bench into a run folder: limits before, safety during, files after."""

from __future__ import annotations

from dataclasses import replace
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchtool.acquire.inputs import RecordInputs
from benchtool.acquire.pitch import PitchRecording, arming_text, check_experiment
from benchtool.bench.bench import Readings
from benchtool.bench.drivers import open_bench
from benchtool.bench.guard import GuardedBench
from benchtool.core.errors import InputError, LimitExceeded, PlanError
from benchtool.core.rig_file import load_rig_by_name
from benchtool.core.schedule import load_schedule
from benchtool.data.run.append import read_events
from benchtool.data.run.read import read_pitch, read_samples
from benchtool.data.run.run import Run
from benchtool.data.run.run_writer import RunWriter

RIG = load_rig_by_name("pquad")
ADDRESS = "sim:pquad?mode=pitch&seed=3"
HOVER = RecordInputs(address=ADDRESS)


def recorded(
    path: Path, inputs: RecordInputs = HOVER, address: str = ADDRESS
) -> tuple[Run, PitchRecording]:
    pitch = PitchRecording(inputs, RIG)
    facts = {"state": "running", "simulated": True, "experiment": "pitch"}
    run = Run.create(path, inputs.plan_text(RIG), facts)
    try:
        with GuardedBench(open_bench(address), RIG) as bench:
            pitch.record(bench, run)
    finally:
        run.close()
    return run, pitch


def test_a_recording_is_a_pitch_recording_of_what_the_simulation_gives(tmp_path):
    from benchtool.physics.model_file import load_model
    from benchtool.simulate.controllers.laws import build_pitch_controller
    from benchtool.simulate.gain_file import load_gains
    from benchtool.simulate.pitch.bench import PitchBench
    from benchtool.simulate.pitch.run import PitchJob
    from benchtool.simulate.pitch.simulate import simulate_pitch

    run, summary = recorded(tmp_path / "run")
    recording = read_pitch(run.path)
    assert recording.simulated
    assert recording.names == (
        *("time_s", "theta_ref_rad", "theta_rad", "gyro_rad_s"),
        *("pwm1_us", "pwm2_us", "pwm3_us", "pwm4_us", "rpm1", "rpm2", "rpm3", "rpm4"),
        *("plate_z_m", "torque_Nm", "disturbance_Nm"),
    )
    units = [channel.unit for channel in recording.channels]
    assert units[:5] == ["s", "rad", "rad", "rad/s", "pwm_us"]
    assert len(recording) == 10_000
    assert np.diff(recording.column("time_s")) == pytest.approx(0.004)
    job = PitchJob(
        PitchBench.from_model(load_model("pitch_pquad").model),
        build_pitch_controller("pid", load_gains("s3")),
    )
    expected = simulate_pitch(job, load_schedule("plate").sampled(250.0, 0.12), seed=3)
    # The device began its schedule when the ramp armed it, a little before this recording.
    plate = recording.column("plate_z_m")
    began = int(np.flatnonzero(plate < 1.0)[0])
    lead = int(np.flatnonzero(expected.column("plate_z_m") < 1.0)[0]) - began
    assert 0 <= lead <= 200
    seen = slice(1500, 9000)
    theta = recording.column("theta_rad")[seen]
    simulated = expected.column("theta_rad")[seen.start + lead : seen.stop + lead]
    assert np.degrees(np.abs(theta - simulated).max()) < 0.5
    assert np.degrees((theta - simulated).std()) < 0.05
    assert summary.rms_error_rad == pytest.approx(radians(1.08), rel=0.05)
    assert "40 s" in summary.summary()


def test_it_begins_at_rest_and_ends_with_motors_that_stand_still(tmp_path):
    run, summary = recorded(tmp_path / "run", replace(HOVER, seconds=2.0))
    samples = read_samples(run.path)
    rpm = samples.column("rpm1")
    assert rpm[~np.isnan(rpm)][0] < 60.0
    assert samples.column("pwm1_us")[-1] <= 1100.0
    assert run.metadata["state"] == "ended"
    assert run.metadata["samples"]["parquet_sha256"]
    assert [event.event for event in read_events(run.path / "events.jsonl")] == [
        "armed",
        "standstill",
        "ended",
    ]
    assert summary.recorder.quality.lost == 0
    # The ramps are in the file, too: what is told is what it holds.
    assert summary.recorder.quality.samples == len(samples) == run.metadata["link"]["samples"] > 500
    assert f"{len(samples)} samples" in summary.summary()


def test_the_plate_is_sent_before_anything_spins(tmp_path):
    away = "sim:pquad?mode=pitch&schedule=steps"
    run, _ = recorded(tmp_path / "run", replace(HOVER, seconds=1.0, plate_z_m=0.24), away)
    plate = read_pitch(run.path).column("plate_z_m")
    assert np.nanmax(np.abs(plate - 0.24)) < 1e-6


def test_an_angle_beyond_the_limit_stops_it_and_is_on_the_disk(tmp_path):
    path = tmp_path / "run"
    with pytest.raises(LimitExceeded, match="theta_rad"):
        recorded(path, replace(HOVER, limit_deg=1.0))
    assert Run.open(path).metadata["state"] == "stopped"
    theta = read_samples(path).column("theta_rad")
    assert np.abs(theta).max() > radians(1.0)
    assert read_events(path / "events.jsonl")[-1].event == "stopped"


class Interrupted:
    """Be a bench that is interrupted after so many seconds, or whose disk is full."""

    def __init__(self, error: BaseException, after_s: float) -> None:
        self._bench, self._error, self._after_s = open_bench(ADDRESS), error, after_s
        self.stops = 0

    def __getattr__(self, name: str) -> object:
        return getattr(self._bench, name)

    def stop(self) -> None:
        self.stops += 1
        self._bench.stop()

    def read(self, timeout_s: float) -> Readings:
        if self._bench.now_s() > self._after_s and not self.stops:
            raise self._error
        return self._bench.read(timeout_s)


def test_ctrl_c_commands_zero_at_once(tmp_path):
    run = Run.create(tmp_path / "run", HOVER.plan_text(RIG), {"state": "running"})
    bench = Interrupted(KeyboardInterrupt(), 3.0)
    with pytest.raises(KeyboardInterrupt), GuardedBench(bench, RIG) as guarded:  # type: ignore[arg-type]
        PitchRecording(HOVER, RIG).record(guarded, run)
    assert bench.stops >= 1
    assert "Ctrl-C" in run.metadata["reason"]
    assert run.metadata["state"] == "stopped"


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"seconds": 0.0}, "seconds is 0"),
        ({"seconds": float("nan")}, "seconds is nan"),
        ({"collective": 1050.0}, "1050 us"),
        ({"collective": 1960.0}, "1950 us"),
        ({"limit_deg": 114.6}, "at most 90"),
        ({"plate_z_m": 0.001}, r"0\.05"),
    ],
)
def test_what_the_limits_do_not_allow_is_refused(changes, told):
    with pytest.raises(InputError, match=told):
        check_experiment(replace(HOVER, **changes), RIG)


def test_limits_of_device_and_rig_hold():
    assert check_experiment(HOVER, RIG).thrust_N == pytest.approx(1.4 * 9.81, rel=0.01)
    assert "5505 rpm" in arming_text(HOVER, RIG, check_experiment(HOVER, RIG))
    with open_bench(ADDRESS) as bench:
        device = bench.identity
    with pytest.raises(PlanError, match="1500 us"):
        check_experiment(HOVER, RIG, replace(device, limits={"pwm_us": 1500.0}))
    with pytest.raises(PlanError, match="rpm"):
        check_experiment(HOVER, RIG, replace(device, limits={"rpm": 5000.0}))
    with pytest.raises(PlanError, match="1700 us"):
        check_experiment(HOVER, RIG, replace(device, limits={}, pwm_idle_us=1700.0))
    weak = replace(RIG, limits=replace(RIG.limits, thrust_N=10.0))
    with pytest.raises(PlanError, match="10 N"):
        check_experiment(HOVER, weak)


def test_zero_comes_before_the_samples_of_a_beam_that_turned_too_far_are_written(
    tmp_path, monkeypatch
):
    strict = replace(HOVER, limit_deg=0.01)
    did: list[str] = []
    stop, write = GuardedBench.stop, RunWriter.samples

    def noted_stop(self: GuardedBench) -> None:
        did.append("stop")
        stop(self)

    def noted_write(self: RunWriter, *values: Any) -> None:
        beyond = np.abs(values[-1][:, 1]) > strict.pitch_limit_rad  # theta_rad
        did.append("beyond" if beyond.any() else "within")
        write(self, *values)

    monkeypatch.setattr(GuardedBench, "stop", noted_stop)
    monkeypatch.setattr(RunWriter, "samples", noted_write)
    with pytest.raises(LimitExceeded, match="theta_rad"):
        recorded(tmp_path / "run", strict)
    assert did.index("within") < did.index("stop") < did.index("beyond")
