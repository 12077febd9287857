"""One contract for every registered driver: what a newcomer may forget is found here by name."""

from __future__ import annotations

import inspect
import pkgutil
from importlib import import_module

import numpy as np
import pytest

import benchtool.bench
import benchtool.virtual
from benchtool.bench.bench import Bench, ContextBench
from benchtool.bench.drivers import DRIVERS, open_bench, parse_address
from benchtool.bench.stop_requests import StoppableBench
from benchtool.core.errors import BenchError, BenchtoolError, DeviceStopped, UnknownChoice
from tests.contracts.benches import CASES, STOP_US, stand_case

DRIVEN = {name: case for name, case in CASES.items() if name != "replay"} | {"stand": stand_case}
"""Those that drive motors, and the driver that the page "write a driver" writes."""

LINKED = {name: case for name, case in DRIVEN.items() if name != "sim"}
"""Those whose device can lose its host."""

driven = pytest.mark.parametrize("case", DRIVEN.values(), ids=DRIVEN)
linked = pytest.mark.parametrize("case", LINKED.values(), ids=LINKED)


def driver_classes() -> set[type]:
    """Find every class of the package that drives a bench itself, not one around another."""
    found = set()
    for room in (benchtool.bench, benchtool.virtual):
        for module in pkgutil.walk_packages(room.__path__, f"{room.__name__}."):
            for _, kind in inspect.getmembers(import_module(module.name), inspect.isclass):
                if issubclass(kind, ContextBench) and not inspect.isabstract(kind):
                    found.add(kind)
    return {kind for kind in found if not issubclass(kind, StoppableBench)}


def test_every_driver_class_is_registered():
    modules = {driver.opener.partition(":")[0] for driver in DRIVERS.values()}
    lost = {kind.__name__ for kind in driver_classes() if kind.__module__ not in modules}
    lost |= set(CASES) - set(DRIVERS)
    assert lost == set(), "register them in benchtool/bench/drivers.py"


def test_every_driver_has_a_case():
    assert set(DRIVERS) <= set(CASES), "add a case to tests/contracts/benches.py"


@pytest.mark.parametrize("scheme", DRIVERS)
def test_an_address_leads_to_its_opener_and_ends(scheme):
    driver = DRIVERS[scheme]
    address = parse_address(driver.address.EXAMPLE)
    assert type(address) is driver.address
    assert callable(pkgutil.resolve_name(driver.opener))
    with pytest.raises(UnknownChoice, match="option of"):
        open_bench(f"{scheme}:somewhere?no_such_option=1")


@pytest.mark.parametrize("case", [*CASES.values(), stand_case], ids=[*CASES, "stand"])
def test_it_opens_says_who_answers_and_reads_in_order(case):
    bench = case().bench
    with pytest.raises(BenchError, match=r"open it first|call open"):
        bench.read(0.1)
    with bench:
        assert isinstance(bench, Bench)
        identity = bench.identity
        assert identity.device_id
        assert identity.protocol
        assert identity.rate_Hz > 0.0
        until_s, parts = bench.now_s() + 0.5, []
        while bench.now_s() < until_s:
            parts.append(bench.read(0.1).time_s)
        times_s = np.concatenate(parts)
    assert len(times_s) > 20
    assert np.all(np.diff(times_s) > 0.0)


def pulse(bench: Bench, duration_s: float) -> float:
    """Read for so long; return the last pulse that the bench showed."""
    names = [channel.name for channel in bench.identity.channels]
    until_s, last_us = bench.now_s() + duration_s, np.nan
    while (left_s := until_s - bench.now_s()) > 1e-6:
        shown = bench.read(min(left_s, 0.1)).values[:, names.index("pwm1_us")]
        if np.isfinite(shown).any():
            last_us = float(shown[np.isfinite(shown)][-1])
    return last_us


@driven
def test_reading_keeps_a_motor_turning(case):
    with case().bench as bench:
        bench.set_pwm(np.array([1400.0]))
        assert pulse(bench, 2.0) == pytest.approx(1400.0, abs=3.0), "read sends no heartbeat"
        bench.stop()
        assert pulse(bench, 0.5) == STOP_US


@linked
def test_a_host_that_hangs_falls_silent(case):
    bench, link = case()
    assert link is not None
    with bench:
        bench.set_pwm(np.array([1400.0]))
        pulse(bench, 0.5)
        sent = len(link.sent)
        link.pass_time(1.0)
        assert len(link.sent) == sent, "a thread sends heartbeats: a host that hangs drives on"
        with pytest.raises((DeviceStopped, BenchtoolError)):
            pulse(bench, 1.0)


@driven
def test_a_pulse_beyond_the_limit_is_refused(case):
    with case().bench as bench, pytest.raises(BenchtoolError):
        bench.set_pwm(np.array([2500.0]))


@linked
def test_closing_stops_the_motor(case):
    bench, link = case()
    with bench:
        bench.set_pwm(np.array([1400.0]))
        pulse(bench, 0.5)
    bench.close()
    assert link is not None
    firmware = link.device.firmware
    assert (firmware.pwm_us == firmware.hello.pwm_stop_us).all()
