"""One cell of the fault matrix: a whole sweep of one visit with one fault in it, and what must hold
whatever the fault is: motors stand and stay so, the end is named, stored rows are measured ones.
"""

from __future__ import annotations

import traceback
from dataclasses import dataclass, replace
from math import isnan, nan
from pathlib import Path

import numpy as np

from benchtool.data.run.read import read_points, read_samples
from benchtool.data.run.run import Run
from tests.faults.dialects import TURNING_US, Phase
from tests.faults.loop import Hangs, Outcome, World, plan, sweep_in
from tests.faults.proxy import Fault

WATCHDOG_S = 0.25
SLACK_S = 0.05  # a few steps of the clock, and what is on its way

THRUST_N, PLATES_M = 2.303, (1.36, 1.32)
"""Of the sweep that nothing is done to. It has one visit, and a second one where a stage is needed
again only for that."""


@dataclass(frozen=True)
class Expected:
    """How a cell ends.

    Attributes:
        codes: exit codes.
        cause: words of the last line, with `...` between; empty where the run ends well.
        within_s: from the fault's begin to motors at zero for good; None where the fault takes
            nothing away that motors need, so that any time is right.
    """

    codes: tuple[int, ...] = (0,)
    cause: str = ""
    within_s: float | None = None


@dataclass(frozen=True)
class Cell:
    link: str
    phase: Phase
    fault: str
    expected: Expected

    @property
    def name(self) -> str:
        return f"{self.link}-{self.phase}-{self.fault}".replace(" ", "_")

    @property
    def visits(self) -> int:
        return 2 if self.link == "grbl" and self.phase not in ("homing", "moving") else 1


@dataclass(frozen=True)
class Result:
    """What came of a cell; `zero_s` is nan where no motor turned behind the fault's begin, `wrong`
    empty where all holds.
    """

    code: int
    last_line: str
    zero_s: float
    hit: int
    wrong: str = ""


def run_cell(cell: Cell, fault: Fault, folder: Path) -> Result:
    """Sweep with a fault, and judge what came of it."""
    world = World([fault], link=cell.link)
    try:
        distances = ", ".join(map(str, PLATES_M[: cell.visits]))
        outcome = sweep_in(world, folder, plan(distances))
    except Hangs:
        return Result(-1, "", nan, fault.hit, "the run does not end")
    finally:
        world.close()
    standing_s, begun_s = outcome.standing_at(), fault.begun_s
    turned = standing_s is not None and begun_s is not None and standing_s > begun_s
    turned &= any(us >= TURNING_US for _, us in outcome.pulses)
    zero_s = standing_s - begun_s if turned else nan  # type: ignore[operator]
    result = Result(outcome.code, outcome.last_line, zero_s, fault.hit)
    try:
        assert fault.hit > 0, "the fault met nothing"
        check_sentence(outcome, cell.expected)
        check_motors(outcome, cell.visits)
        check_folder(outcome, cell.visits)
        check_rows(outcome, cell.link, fault)
        check_lost(outcome, cell.link, fault)
        if cell.expected.within_s is not None and outcome.code != 0 and not isnan(zero_s):
            assert zero_s <= cell.expected.within_s, f"zero after {zero_s:.2f} s"
    except Exception as error:  # noqa: BLE001 - a folder that cannot be read is as wrong
        where = traceback.extract_tb(error.__traceback__)[-1]
        words = f"{type(error).__name__} {error} ({where.name}: {where.line})"
        return replace(result, wrong=words)
    return result


def check_motors(outcome: Outcome, visits: int) -> None:
    """Motors stand when all is over, soon after the host has gone; they turn once in a visit."""
    standing_s = outcome.standing_at()
    assert standing_s is not None, "a motor turns for ever"
    assert standing_s <= outcome.left_s + WATCHDOG_S + SLACK_S
    turning = [us >= TURNING_US for _, us in outcome.pulses]
    begins = sum(
        now and not before for before, now in zip([False, *turning], turning, strict=False)
    )
    assert begins <= visits, f"motors turned again: {outcome.pulses}"
    if outcome.pulse_at(outcome.left_s) >= TURNING_US:
        assert outcome.code == 8, outcome.last_line


def check_sentence(outcome: Outcome, expected: Expected) -> None:
    """The exit code and the cause are right, and nothing is a traceback."""
    assert outcome.code in expected.codes, outcome.said
    assert all(words in outcome.last_line for words in expected.cause.split("...")), outcome.said
    assert "Traceback" not in outcome.said


def check_folder(outcome: Outcome, visits: int) -> None:
    """The run's folder is closed and reads; without one no motor has turned."""
    run = outcome.folder / "run"
    if not run.exists():
        assert outcome.code != 0
        assert max(us for _, us in outcome.pulses) < TURNING_US
        return
    facts = Run.open(run).metadata
    assert len(read_samples(run)) == len(outcome.rows())
    measured = [point for point in outcome.points() if point["kind"] == "measure"]
    # A run that ends early behind its last point has measured all the same.
    assert facts["state"] == ("ended" if len(measured) == visits else "stopped")
    assert ("sweep --resume" in outcome.said) == (len(measured) < visits)
    assert ("every visit is measured and stored" in outcome.said) == (
        outcome.code != 0 and len(measured) == visits
    )
    assert len(measured) == visits or outcome.code != 0
    for point, plate_m in zip(measured, PLATES_M, strict=False):
        assert abs(float(point["thrust_N"]) - THRUST_N) < 0.06
        assert abs(float(point["plate_z_m"]) - plate_m) < 0.006
        assert float(point["n_samples"]) > 100
    if measured:
        assert len(read_points(run)) == len(measured)


COMPARED = {"mavlink": {"thrust_raw": "thrust_N", "plate_z_m": "plate_z_m"}}
"""Columns that hold a device's own value at its own time, where these are not all columns."""

TICK_US = 5000
TICKS = {"mavlink": 3}
"""A row that is made of several messages holds values of so many ticks around its time."""


def check_rows(outcome: Outcome, link: str, fault: Fault) -> None:
    """Each stored value is what the device measured at that time; rows come once and in order."""
    rows, world = outcome.rows(), outcome.world
    times_us = np.array([float(row["device_time_us"] or "nan") for row in rows])
    least_us = 0.0 if link == "mavlink" else 0.5 * TICK_US
    assert np.all(np.diff(times_us[np.isfinite(times_us)]) > least_us), "rows twice or out of order"
    if not rows:
        return
    names = list(rows[0])[4:]
    if link not in COMPARED:
        assert names == world.channels
    true_us = np.array(list(world.rows), float)
    true = held(np.array(list(world.rows.values())))
    falsified = fault.channel if fault.kind in ("freeze", "lie") else ""
    stored = {
        name: (np.array([float(row[name] or "nan") for row in rows]), world.channels.index(own))
        for name, own in COMPARED.get(link, {name: name for name in names}).items()
        if own != falsified and name in names
    }

    at = np.searchsorted(true_us, times_us, "right") - 1
    beside = range(-TICKS.get(link, 0), TICKS.get(link, 0) + 1)
    for name, (values, column) in stored.items():
        near = [true[np.clip(at + step, 0, len(true) - 1), column] for step in beside]
        right = np.isclose(near, values, rtol=2e-6, atol=2e-9).any(axis=0)
        wrong = np.flatnonzero(np.isfinite(values) & ~right)
        assert not len(wrong), (
            f"the device did not measure {name} {values[wrong[0]]:g} at {times_us[wrong[0]]:.0f} us"
        )


def check_lost(outcome: Outcome, link: str, fault: Fault) -> None:
    """The run counts the samples that it missed: each that a fault kept from between its rows, and
    none that came. An autopilot's messages bear one number for all kinds, so that it counts those.
    """
    times_us = [float(row["device_time_us"] or "nan") for row in outcome.rows()]
    if not times_us or link == "mavlink":
        return
    # A bit that turns `A` into `a` in a checksum does no harm.
    dropped_us = [at_us for at_us in outcome.seen.dropped_us if at_us and at_us not in times_us]
    between = sum(times_us[0] < at_us < times_us[-1] for at_us in dropped_us)
    lost = outcome.metadata["link"]["lost"]
    assert between <= lost
    # Of a line that was cut within its time nobody knows the time; it cost one sample at most.
    untimed = max(0, fault.hit - len(dropped_us)) if fault.kind == "truncate" else 0
    assert lost <= len(dropped_us) + untimed


def held(values: np.ndarray) -> np.ndarray:
    """Return rows (n, c) in which each channel holds its last value."""
    last = np.where(np.isfinite(values), np.arange(len(values))[:, None], 0)
    return np.take_along_axis(values, np.maximum.accumulate(last, axis=0), axis=0)
