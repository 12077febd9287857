"""From an autopilot's log of a hinged vehicle to the effect that its model lacks."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchtool.core.recording import Recording
from benchtool.core.schedule import load_schedule
from benchtool.physics.model_file import load_model
from benchtool.simulate.controllers.pitch import PitchControl
from benchtool.simulate.gain_file import load_gains
from benchtool.simulate.pitch.bench import PitchBench
from benchtool.simulate.pitch.run import PitchJob
from benchtool.simulate.pitch.simulate import simulate_pitch
from tests.unit.commands.command_line import run
from tests.unit.data.flight_logs import Record, dataflash

FRICTION_NM = 0.012
RATE_HZ = 250.0


def flown(seed: int) -> Recording:
    model = load_model("pitch_beam").model.with_fixed("coulomb_friction.torque_Nm", FRICTION_NM)
    control = PitchControl(name="pid", gains=load_gains("s3"), rate_Hz=RATE_HZ)
    schedule = replace(load_schedule("identify").with_duration(24.0), plate=())
    sampled = schedule.sampled(RATE_HZ, model.rig.propulsion.radius_m)
    job = PitchJob(PitchBench.from_model(model), control)
    return simulate_pitch(job, sampled, seed).recording(model.rig)


def log_of(recording: Recording) -> bytes:
    """Give the log that ArduPilot writes of it: a message for each sensor, pitch nose up."""
    items: list[Record] = [("MSG", (0, b"ArduCopter V4.5.7"))]
    for channel, function in ((1, 33), (2, 34)):
        name = f"SERVO{channel}_FUNCTION".encode()
        items.append(("PARM", (0, name, float(function), 0.0)))
    columns = {name: recording.column(name) for name in recording.names}
    for tick in range(len(recording)):
        at = 5_000_000 + 4000 * tick
        row = {name: values[tick] for name, values in columns.items()}
        wanted, pitch = (
            round(-100.0 * np.degrees(row[name])) for name in ("theta_ref_rad", "theta_rad")
        )
        items.append(("IMU", (at, 0, 0.0, -row["gyro_rad_s"], 0.0)))
        items.append(("ATT", (at + 40, 0, 0, wanted, pitch, 0, 0)))
        items.append(("RCOU", (at + 90, round(row["pwm1_us"]), round(row["pwm2_us"]), 0, 0)))
        if tick % 5 == 0:  # ESC telemetry at 50 Hz
            items.extend(
                ("ESC", (at + 140, esc, row[f"rpm{esc + 1}"], 11.1, 3.0, 0)) for esc in (0, 1)
            )
    return dataflash(items)


def test_friction_is_named_from_two_flight_logs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for seed, name in ((1, "learn"), (2, "check")):
        Path(f"{name}.bin").write_bytes(log_of(flown(seed)))
        assert run("import", f"{name}.bin") == 0
    Path("beam.toml").write_text(
        '[model]\nname = "mine"\nrig = "beam"\nwake_rule = "full"\n'
        "[effects.wake_torque]\nsd_Nm = 0.004\ncorrelation_s = 0.1\n",
        encoding="utf-8",
    )
    assert run(
        "explain", "imported/learn.csv", "--model", "beam.toml",
        "--check", "imported/check.csv", "--draws", "30", "--json", "found.json", "--verbose",
    ) == 0  # fmt: skip
    said = capsys.readouterr().out
    assert "learn.csv: rows are not even in time: resampled at 250 Hz" in said
    assert "the plate is assumed to be parked" in said
    found = json.loads(Path("found.json").read_text("utf-8"))
    assert found["verdict"] == "effect", found["sentence"]
    (effect,) = found["effects"]
    assert effect["name"] == "coulomb_friction"
    assert effect["probability"] > 0.9
    assert effect["parameters"]["torque_Nm"]["value"] == pytest.approx(FRICTION_NM, abs=0.001)
