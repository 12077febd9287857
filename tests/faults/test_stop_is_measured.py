"""A device that acknowledges a stop and does not stop: the host says what it measured."""

from __future__ import annotations

import signal
from dataclasses import replace

import pytest

from benchtool.bench.bench import DeviceInfo, Readings
from benchtool.commands.app import main
from benchtool.core.channel import Channel
from benchtool.data.run.append import read_events
from benchtool.virtual.simulated_bench import SimulatedBench
from tests.faults.dialects import TURNING_US
from tests.faults.loop import plan, sweep
from tests.faults.proxy import Fault


def test_motors_that_ignore_the_stop_are_named_with_their_speed(tmp_path):
    """The stop before the plate moves; the run's own end is a cell of the matrix."""
    fault = Fault("ignore", phase="stopping", way="device")
    outcome = sweep(tmp_path, plan("1.36, 1.32"), [fault])
    assert fault.hit > 2
    # The device really went on turning, until the host was gone and its watchdog stopped it.
    assert [us for s, us in outcome.pulses if s <= outcome.left_s][-1] >= TURNING_US
    assert outcome.standing_at() is not None
    assert outcome.code == 8
    last = outcome.said.strip().splitlines()[-1]
    assert last.startswith("benchtool: MOTORS MAY STILL TURN: rpm1 4")
    assert "cut the power" in last
    assert "motors stopped" not in last
    assert "ended: all is measured" not in outcome.said
    assert "MOTORS MAY STILL TURN: rpm1 4" in outcome.metadata["reason"]
    seen = [e for e in read_events(tmp_path / "run" / "events.jsonl") if "MAY STILL TURN" in e.text]
    assert "not_seen_to_stand" in [event.event for event in seen]


def test_a_stop_that_is_ignored_for_a_moment_is_commanded_again(tmp_path):
    fault = Fault("ignore", phase="stopping", way="device", for_s=0.3)
    outcome = sweep(tmp_path, plan(), [fault])
    assert fault.hit > 2
    assert outcome.code == 0
    assert "rotor 1 was seen to stand" in outcome.said
    standing_s = outcome.standing_at()
    assert standing_s is not None
    assert standing_s <= outcome.left_s


@pytest.mark.parametrize("ends_early", [False, True])
def test_a_bench_without_speeds_is_named_before_arming(tmp_path, monkeypatch, capsys, ends_early):
    told, read = SimulatedBench.identity, SimulatedBench.read
    interrupted: list[float] = []

    def without_speed(bench: SimulatedBench) -> DeviceInfo:
        identity = told.fget(bench)  # type: ignore[attr-defined]
        channels = [Channel("spare_V", "V") if c.name == "rpm1" else c for c in identity.channels]
        return replace(identity, channels=tuple(channels))

    def interrupting(bench: SimulatedBench, timeout_s: float) -> Readings:
        readings = read(bench, timeout_s)
        if ends_early and not interrupted and bench.now_s() > 12.0:
            interrupted.append(bench.now_s())
            signal.raise_signal(signal.SIGINT)
        return readings

    monkeypatch.setattr(SimulatedBench, "identity", property(without_speed))
    monkeypatch.setattr(SimulatedBench, "read", interrupting)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("BENCHTOOL_STATE", str(tmp_path / "state"))
    (tmp_path / "plan.toml").write_text(plan(sample_s=20.0))
    with pytest.raises(SystemExit) as ended:
        main(["sweep", "sim:pquad_single", "--plan", "plan.toml", "--yes", "--out", "run"])
    told_text = capsys.readouterr()
    before, after = (told_text.out + told_text.err).split("rotors that will turn", 1)
    assert "rotor 1 will not be seen to stand" in before
    assert "rotor 1 was not seen to stand" in after
    assert bool(interrupted) == ends_early
    assert ended.value.code == (8 if ends_early else 0)
