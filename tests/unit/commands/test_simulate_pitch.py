"""Command `benchtool simulate pitch`: output, files and errors."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.data.run.read import read_samples
from benchtool.data.run.recording_file import read_recording
from benchtool.report.flight.pitch_study import pitch_study
from benchtool.simulate.inputs import PitchInputs
from benchtool.simulate.pitch.setup import pitch_setup
from tests.unit.commands.command_line import said

SHORT = ("--duration-s", "13")


def simulate(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    return said(capsys, "simulate", "pitch", *arguments)


def test_files_are_written_and_not_overwritten(capsys, tmp_path):
    out = tmp_path / "study"
    arguments = (*SHORT, "--controllers", "pid,observer+feedforward", "--out", str(out))
    assert simulate(capsys, *arguments)[0] == 0
    assert read_recording(out / "pid.csv").simulated
    recording = read_samples(out / "pid.csv")
    assert len(recording) == 13 * 250
    parked = recording.column("plate_z_m") == 1.0
    assert parked[:2000].all()
    assert recording.column("plate_z_m")[~parked].mean() == pytest.approx(0.24, abs=1e-3)
    code, _, err = simulate(capsys, *arguments)
    assert code == 2
    assert "exists already" in err


def test_a_user_controller_on_the_command_line(capsys, tmp_path, monkeypatch):
    (tmp_path / "lawofmine.py").write_text(
        "class Law:\n    def step(self, measurement, reference, dt_s):\n"
        "        error = reference.theta_rad - measurement.theta_rad\n"
        "        return 0.018 * 7.4 * (2.9 * error - measurement.rate_rad_s)\n"
        "class Bad:\n    def step(self, measurement, reference, dt_s):\n"
        "        return 1.0 / 0.0\n",
        encoding="utf-8",
    )
    monkeypatch.chdir(tmp_path)
    code, out, _ = simulate(capsys, *SHORT, "--controllers", "pid,lawofmine:Law")
    assert code == 0
    pid, user = out.splitlines()[3:5]
    assert pid.split()[1:] == user.split()[1:]
    code, _, err = simulate(capsys, *SHORT, "--controllers", "lawofmine:Bad")
    assert code == 2
    assert "lawofmine.py line 7: return 1.0 / 0.0" in err


def test_numbers_are_set_by_name():
    setup = pitch_setup(PitchInputs()).with_changes(
        {
            "K_b": 1.5,
            "hinge_spring.stiffness_Nm_per_rad": 0.3,
            "gains.attitude": 1.2,
            "gains.observer.rate_per_s": 6.0,
            "bench.inertia_kgm2": 0.02,
            "feedforward.strength": 0.8,
        },
    )
    assert setup.bench.model.parameters["body_lift.K_b"].value == 1.5
    assert setup.bench.model.parameters["hinge_spring.stiffness_Nm_per_rad"].value == 0.3
    pid, feedforward, observer = setup.controls
    assert pid.gains is not None
    assert pid.gains.attitude.k_theta_per_s == pytest.approx(2.9 * 1.2)
    assert pid.gains.attitude.rate_limit_rad_s == 3.5
    assert observer.gains is not None
    assert observer.gains.observer.rate_per_s == 6.0
    assert setup.bench.inertia_kgm2 == 0.02
    assert feedforward.feedforward.strength == 0.8
    assert pid.feedforward.strength == 0.0


def test_a_switch_to_the_observer_removes_the_offset():
    """Fig. 27: fixed plate, bumpless switch to the observer at 20 s."""
    study = pitch_study(pitch_setup(PitchInputs(schedule="switch", controllers=("observer",))))
    run = study.runs[0]
    theta = np.degrees(run.column("true_theta_rad"))
    time_s = run.time_s
    assert theta[(time_s > 15.0) & (time_s < 20.0)].mean() == pytest.approx(-1.6, abs=0.25)
    assert abs(theta[(time_s > 25.0) & (time_s < 30.0)].mean()) < 0.15
    torque = run.column("torque_Nm")
    switch = int(20.0 * run.rate_Hz)
    assert abs(torque[switch] - torque[switch - 1]) < 5.0 * np.std(
        np.diff(torque[switch - 500 : switch])
    )
