"""The compiled firmware and the program that plays its surroundings, built once."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchtool.core.rig_file import load_rig_by_name
from tests.avr.avr_bench import AvrBench, PacedAvrBench, build, build_peer, missing, physics

RIG = load_rig_by_name("pquad_single")
PAIR = replace(  # two motors, and the pulse limit of the protocol's page
    RIG,
    name="pair",
    rotors=(RIG.rotors[0], replace(RIG.rotors[0], name="second", x_m=0.3)),
    limits=replace(RIG.limits, pwm_us=1900.0),
)


@pytest.fixture(scope="session")
def peer(tmp_path_factory):
    if reason := missing():
        pytest.skip(reason)
    return build_peer(tmp_path_factory.mktemp("peer"))


@pytest.fixture(scope="session")
def firmware(tmp_path_factory, peer):
    """Give the firmware for one motor, its slope that of the simulated load cell."""
    folder = tmp_path_factory.mktemp("one")
    return build(folder, RIG, NEWTON_PER_COUNT=f"{physics(RIG).count_N}f")


@pytest.fixture(scope="session")
def pair_firmware(tmp_path_factory, peer):
    """Give the firmware for two motors."""
    return build(tmp_path_factory.mktemp("two"), PAIR)


@pytest.fixture
def bench(peer, firmware):
    with AvrBench(peer, firmware, RIG) as running:
        yield running


@pytest.fixture
def pair(peer, pair_firmware):
    with AvrBench(peer, pair_firmware, RIG) as running:
        yield running


@pytest.fixture
def paced(peer, firmware):
    with PacedAvrBench(peer, firmware, RIG) as running:
        yield running
