"""The virtual clock, the proxy and its faults do what the tests over them rely on."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.faults.loop import World, plan, sweep
from tests.faults.proxy import Fault, Kind, Proxy, fields_in, framed


def test_a_sweep_without_faults(tmp_path: Path) -> None:
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


def test_the_host_may_stand_still_while_the_device_goes_on(tmp_path: Path) -> None:
    paused_s: list[float] = []

    def pause(world: World) -> None:
        begun_s = world.proxy.seen.phases.get("sampling")
        if not paused_s and begun_s is not None and world.now_s > begun_s + 0.3:
            paused_s.append(world.now_s)
            world.wait(2.0)

    outcome = sweep(tmp_path, plan(sample_s=30.0), [], hooks=[pause])
    zero_s = min(s for s, us in outcome.pulses if s > paused_s[0] and us <= 1000.0)
    assert zero_s - paused_s[0] < 0.3  # the device's watchdog
    assert outcome.code != 0


LINES = [framed(f"S,{number},{10 * number},5") for number in range(4)]


@pytest.mark.parametrize(
    ("kind", "arrived"),
    [
        ("drop", []),
        ("duplicate", [0, 0, 1, 1, 2, 2, 3, 3]),
        ("reorder", [1, 0, 3, 2]),
        ("delay", [0, 1, 2, 3]),
        ("stall", [0, 1, 2, 3]),
        ("truncate", []),
        ("corrupt", []),
        ("cut", []),
    ],
)
def test_what_a_fault_does_to_lines(kind: Kind, arrived: list[int]) -> None:
    now_s = [0.0]
    fault = Fault(kind, phase="connect", for_s=1.0, way="host")
    proxy = Proxy([fault], lambda: now_s[0])
    proxy.connect()
    proxy.far.incoming.waiting += b"".join(LINES)
    proxy.step()
    if kind in ("delay", "stall"):
        assert not proxy.near.outgoing.waiting
    now_s[0] = 1.5
    proxy.step()
    came = [fields_in(line) for line in bytes(proxy.near.outgoing.waiting).splitlines(True)]
    assert [int(fields[1]) for fields in came if fields] == arrived
    assert fault.hit >= 1
    assert len(proxy.seen.rows) == 4


@pytest.mark.parametrize(("kind", "values"), [("freeze", [5, 5, 5]), ("lie", [6, 7, 8])])
def test_samples_that_lie(kind: Kind, values: list[float]) -> None:
    fault = Fault(kind, phase="connect", channel="plate_z_m", value=1.0)
    proxy = Proxy([fault], lambda: 0.0)
    proxy.connect()
    proxy.seen.channels.append("plate_z_m")
    proxy.far.incoming.waiting += b"".join(framed(f"S,{i},{i},{5 + i}") for i in range(3))
    proxy.step()
    came = [fields_in(line) for line in proxy.near.outgoing.take().splitlines(True)]
    assert [float(fields[3]) for fields in came] == values
    assert fault.hit == 3


def test_a_command_that_is_acknowledged_and_not_done() -> None:
    fault = Fault("ignore", phase="connect", way="device")
    proxy = Proxy([fault], lambda: 0.0)
    proxy.connect()
    proxy.near.incoming.waiting += framed("C,7,stop")
    proxy.step()
    assert proxy.near.outgoing.take() == framed("A,7,0")
    assert proxy.far.outgoing.take() == framed("B")
    assert (fault.hit, proxy.seen.commands) == (1, [(0.0, "stop")])
