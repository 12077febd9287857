"""The guard against the faults that a virtual bench can be given, over the wire protocol."""

import numpy as np
import pytest

from benchtool.bench.guard import GuardedBench
from benchtool.bench.serial.bench import SerialBench
from benchtool.core.errors import LimitExceeded, StageError, StandstillNotSeen
from benchtool.core.rig_file import rig_named
from benchtool.physics.model_file import load_model
from benchtool.testing.loopback_link import LoopbackLink
from benchtool.virtual.devices import hello_of, virtual_plant
from benchtool.virtual.faults import FaultyPlant, LinkFaults, fault_from
from benchtool.virtual.firmware import Firmware

RIG = rig_named("pquad")
TRUTH = load_model("quad_body_lift", RIG).model


def looped(*faults):
    named = [fault_from(text) for text in faults]
    physics = virtual_plant(RIG, TRUTH, 3)
    plant = FaultyPlant(physics, named)
    firmware = Firmware(plant, hello_of(physics, TRUTH, 3))
    link = LoopbackLink(
        firmware, lambda: plant.rate_Hz, LinkFaults(named, np.random.default_rng(1))
    )
    return link, firmware, SerialBench(link, "serial:loop", clock=link.clock)


def drive(bench, seconds=12.0):
    bench.tare()
    bench.set_pwm(np.full(4, 1500.0))
    until_s = bench.now_s() + seconds
    while bench.now_s() < until_s:
        bench.read(0.1)


@pytest.mark.parametrize(
    ("fault", "error", "said"),
    [
        ("stuck:channel=thrust_N,at_s=2,for_s=99", LimitExceeded, "all the time"),
        (
            "stuck:channel=rpm2,at_s=0,for_s=99",
            StandstillNotSeen,
            "rotor 2 was not seen to stand: .* does not fit a pulse of 1500 us",
        ),
    ],
)
def test_a_fault_ends_at_zero(fault, error, said):
    link, firmware, bench = looped(fault)
    guard = GuardedBench(bench, RIG)
    with pytest.raises(error, match=said), guard:
        drive(guard)
    assert guard.reason
    link.pass_time(1.0)
    assert np.all(firmware.pwm_us == RIG.propulsion.pwm_stop_us)


def test_a_stage_that_refuses_ends_the_run():
    _, firmware, bench = looped("refuse_move:at_s=0")
    guard = GuardedBench(bench, RIG)
    with pytest.raises(StageError, match="stage alarm"), guard:
        guard.move_plate(0.5)
    assert "stage alarm" in guard.reason
    assert np.all(firmware.pwm_us == RIG.propulsion.pwm_stop_us)
