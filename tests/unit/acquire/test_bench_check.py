from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import date

import numpy as np
import pytest

from benchtool.acquire.bench_check import check_bench
from benchtool.acquire.operator import arming_warnings, require_unattended, store_check_result
from benchtool.bench.bench import Readings
from benchtool.bench.drivers import open_bench
from benchtool.core.errors import BenchError, InputError
from benchtool.core.rig_file import load_rig_by_name
from tests.unit.acquire.fake_bench import FakeBench
from tests.wire.still_plant import still_hello

QUAD = load_rig_by_name("pquad")


class Rewired:
    """Answer as another bench does, with channels changed on the way."""

    def __init__(self, bench, change) -> None:
        self._bench, self._change = bench, change

    def __getattr__(self, name: str):
        return getattr(self._bench, name)

    def read(self, timeout_s: float) -> Readings:
        found = self._bench.read(timeout_s)
        names = [channel.name for channel in self._bench.identity.channels]
        self._change(names, found.values)
        return found


def swap_rotors(names: list[str], values: np.ndarray) -> None:
    one, two = names.index("rpm1"), names.index("rpm2")
    values[:, [one, two]] = values[:, [two, one]]


def scaled(name: str, factor: float) -> Callable[[list[str], np.ndarray], None]:
    def change(names: list[str], values: np.ndarray) -> None:
        values[:, names.index(name)] *= factor

    return change


def test_a_good_bench_passes_every_check():
    with open_bench("sim:pquad?seed=1") as bench:
        findings = list(check_bench(bench, QUAD))
    assert len(findings) == 2 + 3 * 4
    assert [finding for finding in findings if not finding.passed] == []


@pytest.mark.parametrize(
    ("change", "failed"),
    [
        (swap_rotors, ["rotor 1 speed", "rotor 1 channel", "rotor 2 speed", "rotor 2 channel"]),
        (scaled("thrust_N", 102.0), [f"rotor {i} thrust" for i in range(1, 5)]),
        (scaled("thrust_N", -1.0), [f"rotor {i} thrust" for i in range(1, 5)]),
        (scaled("rpm1", 2.0), ["rotor 1 speed"]),
    ],
    ids=["swapped", "grams", "turned", "poles"],
)
def test_wrong_wiring_is_found(change, failed):
    with open_bench("sim:pquad?seed=1") as bench:
        findings = list(check_bench(Rewired(bench, change), QUAD))
    assert [finding.name for finding in findings if not finding.passed] == failed


def test_nothing_is_armed_while_a_rotor_turns():
    bench = FakeBench(idle_rpm=200.0)
    with pytest.raises(BenchError, match="rpm1 reads 200 rpm at zero throttle, limit 30 rpm"):
        list(check_bench(bench, load_rig_by_name("pquad_single")))
    assert {value for what, value in bench.log if what == "pwm"} == {1000.0}


def test_unattended_needs_a_check_of_the_same_day(tmp_path, monkeypatch):
    monkeypatch.setenv("BENCHTOOL_STATE", str(tmp_path))
    identity, today = FakeBench().identity, date(2026, 1, 31)
    with pytest.raises(InputError, match="it was never checked; run benchtool bench check fake:1"):
        require_unattended(identity, load_rig_by_name("pquad_single"), today)
    store_check_result(identity, load_rig_by_name("pquad_single"), ["all good"], date(2026, 1, 30))
    with pytest.raises(InputError, match="the last check passed on 2026-01-30"):
        require_unattended(identity, load_rig_by_name("pquad_single"), today)
    store_check_result(identity, load_rig_by_name("pquad_single"), ["all good"], today)
    require_unattended(identity, load_rig_by_name("pquad_single"), today)
    with pytest.raises(
        InputError, match="today's check used another or changed rig 'pquad_single'"
    ):
        require_unattended(identity, load_rig_by_name("pquad"), today)
    with open_bench("sim:pquad") as bench:
        require_unattended(bench.identity, load_rig_by_name("pquad_single"), today)


def test_what_makes_a_bench_more_dangerous_is_named():
    rig = load_rig_by_name("pquad")
    hello = replace(still_hello(), simulated=False, facts={"warning": "anybody may steer it"})
    warning, unseen, unwatched = arming_warnings(hello.identity("serial:x", 100.0), rig)
    assert warning == "anybody may steer it"
    assert "will not be seen to stand" in unseen
    assert unwatched.startswith("no channel ")
