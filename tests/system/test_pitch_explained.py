"""From a virtual autopilot to a named effect, on a clock that only reading moves."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchtool.acquire.pitch_experiment import PitchExperiment
from benchtool.acquire.pitch_record import record_pitch
from benchtool.bench.guard import GuardedBench
from benchtool.bench.mavlink.bench import MavlinkBench
from benchtool.bench.mavlink.settings import MavlinkSettings, MotorMap
from benchtool.core.rig_file import rig_named
from benchtool.data.run.read import read_pitch
from benchtool.data.run.run import Run
from benchtool.explain.engine.explain import explain
from benchtool.explain.pitch.log import PitchLog, pitch_log
from benchtool.explain.pitch.subject import PitchSubject
from benchtool.physics.model_file import load_model
from benchtool.simulate.pitch.setup import changed_job
from benchtool.testing.loopback_link import LoopbackLink
from benchtool.virtual.autopilot import VirtualAutopilot
from benchtool.virtual.devices import pitch_hello, pitch_plant
from benchtool.virtual.firmware import Firmware

HIDDEN_NM = 0.02
MAP = MotorMap(
    rig="pquad", autopilot="ArduPilot", motors=(1, 4, 3, 2), outputs=(3, 2, 4, 1), escs=(3, 2, 4, 1)
)


def log_of(folder: Path, seed: int, seconds: float) -> PitchLog:
    """Return what an autopilot tells of a hinge with more friction than its model has."""
    rig = rig_named("pquad")
    hidden = {"coulomb_friction.torque_Nm": HIDDEN_NM}
    plant = pitch_plant(
        rig, schedule="identify", seed=seed, change=lambda job: changed_job(job, hidden)
    )
    firmware = Firmware(plant, pitch_hello(plant, seed))
    link = LoopbackLink(VirtualAutopilot(firmware, hover_us=1599.0), lambda: plant.rate_Hz)
    settings = MavlinkSettings(
        system=1, rate_Hz=250.0, mode="pitch", arm="host", distance=True, motor_map=MAP
    )
    bench = MavlinkBench(link, "mavlink:loop", settings, clock=link.clock)
    with GuardedBench(bench, rig) as guarded:
        units = {channel.name: channel.unit for channel in guarded.identity.channels}
        run = Run.create(folder, "", {"simulated": True, "device": {"channels": units}})
        record_pitch(guarded, rig, PitchExperiment(seconds=seconds, collective_us=1599.0), run)
    return pitch_log(read_pitch(folder), rig)


@pytest.mark.timeout(600)
def test_friction_behind_an_autopilot_is_named(tmp_path: Path) -> None:
    learn = log_of(tmp_path / "learn", 3, 24.0)
    assert any("the plate slides in or out" in remark for remark in learn.remarks)
    check = log_of(tmp_path / "check", 4, 16.0)
    subject = PitchSubject(load_model("pitch_pquad").model, [learn], [check])
    verdict = explain(subject, draws=32, propose=False).verdict
    # The autopilot's log leaves 1.7 floors: mostly friction, and unknown is in the class.
    assert verdict.class_members == ("coulomb_friction", "unknown"), verdict.sentence
    found = verdict.effects[0].parameters[0]
    assert found.low <= HIDDEN_NM <= found.high
    assert found.high - found.low < 0.5 * HIDDEN_NM  # the law may be off by a tenth
