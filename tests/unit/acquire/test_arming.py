"""What is said of a bench before it is armed."""

from __future__ import annotations

from dataclasses import replace

from benchtool.acquire.arming import arming_warnings
from benchtool.bench.serial.hello import UNPROTECTED
from benchtool.core.rig_file import rig_named
from tests.wire.still_plant import still_hello


def test_what_makes_a_bench_more_dangerous_is_named() -> None:
    rig = rig_named("pquad")
    hello = replace(still_hello(version=1), simulated=False)
    unprotected, unseen, unwatched = arming_warnings(hello.identity("serial:x", 100.0), rig)
    assert unprotected == UNPROTECTED
    assert "will not be seen to stand" in unseen
    assert unwatched.startswith("no channel brings ")


def test_a_simulated_bench_that_measures_all_needs_no_warning() -> None:
    identity = replace(still_hello(), simulated=True).identity("sim:", 100.0)
    speeds = [replace(identity.channels[0], name=f"rpm{i}") for i in range(1, 5)]
    seen = replace(identity, channels=(*identity.channels, *speeds))
    assert arming_warnings(seen, rig_named("pquad")) == ()
