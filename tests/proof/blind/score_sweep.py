"""Score `benchtool explain` on plate sweeps with hidden effects, and print the scorecard.

`make blind` runs it on scoring seeds.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from benchtool.data.columns import KINDS
from benchtool.data.run.read import read_points
from benchtool.explain.engine.explain import explain
from benchtool.explain.result import Explanation
from benchtool.explain.sweep.log import sweep_log
from benchtool.explain.sweep.subject import SweepSubject
from benchtool.physics.model_file import load_model
from tests.proof.blind.scored import Scored
from tests.proof.blind.scoring import Asked, plan, run, score, single_effects
from tests.proof.blind.sweep.information import information
from tests.proof.blind.sweep.library import NAMED
from tests.proof.blind.sweep.outside import OUTSIDE
from tests.proof.blind.sweep.readings import cell_N, thrust_N
from tests.proof.blind.sweep.records import (
    HiddenSweep,
    make_record,
    swept_again,
    write_record,
    write_table,
)
from tests.proof.blind.sweep.table import RPM, Part

Array = NDArray[np.float64]

PARTS = 20  # rich records of every named effect: 220 in all


def asked(first_seed: int, scale: float, length: int = 0) -> Iterator[Asked]:
    """Yield what is scored."""
    if length:
        return single_effects(NAMED, first_seed, length, parts=PARTS, scale=scale)
    return plan(NAMED, OUTSIDE, first_seed, parts=PARTS, scale=scale)


def verdict_on(record: HiddenSweep, more: Sequence[Part] = ()) -> tuple[Explanation, float]:
    """Return the explanation of a record as a user's files would give it, and its time: s.

    Of further sweeps of the bench the first half are to learn from, the others to check on.
    """
    with TemporaryDirectory() as folder:
        *paths, model_file = write_record(record, Path(folder))
        model = load_model(model_file).model
        points = [read_points(path, KINDS) for path in paths]
        further = []
        for place, part in enumerate(more):
            path = Path(folder) / f"more_{place}" / "points.csv"
            write_table(part.table, path)
            further.append(read_points(path, KINDS))
    half = len(further) // 2
    learn = [sweep_log(part, model.rig) for part in (points[0], *further[:half])]
    check = [sweep_log(part, model.rig) for part in (points[1], *further[half:])]
    subject = SweepSubject(model, learn, check)
    began = time.perf_counter()
    found = explain(subject)
    return found, time.perf_counter() - began


def scored(one: Asked) -> Scored:
    """Make a record and score the verdict on it."""
    record = make_record(one.seed, one.family, excitation=one.excitation, strength=one.strength)
    more = swept_again(record, 2 * (one.length - 1))
    found, seconds = verdict_on(record, more)
    hidden = {
        f"{effect.name}.{name}": value
        for effect in record.truth.effects
        for name, value in effect.parameters.items()
    }
    return score(
        one,
        record.truth,
        found,
        seconds,
        hidden,
        lambda: information(record.parts[0], record.truth.bench),
        true_gaps=_true_gaps(record, found),
    )


def _true_gaps(record: HiddenSweep, verdict: Explanation) -> dict[str, float]:
    """Return how far the true bench misses its own first check sweep, over the stated floor.

    It is told what a model is told: speeds and places as they were read.
    """
    part = record.parts[1]
    bench, rows, table = part.bench, part.rows, record.check
    rotors = range(1, bench.layout.rotors + 1)
    speed = part.drive.speed_rad_s.copy()
    speed[:, part.kept] = np.array([table[f"rpm{i}"].to_numpy() for i in rotors]) / RPM
    shown = cell_N(bench, rows, thrust_N(bench, rows, speed, np.zeros(len(rows.z_m))), speed)
    missed = table["thrust_N"].to_numpy() - shown[part.kept]
    wrong = RPM * (speed - part.drive.speed_rad_s)[:, rows.turning]
    stay = np.array([2 * visit.stay + (visit.kind == "tare") for visit in part.plan.visits])
    found = {
        "thrust_N": _over_stays(missed**2, stay[part.kept]),
        "rpm": _over_stays(np.mean(wrong**2, axis=0), stay[rows.turning]),
    }
    return {gap.channel: found[gap.channel] / gap.floor for gap in verdict.gaps}


def _over_stays(squares: Array, stay: NDArray[np.intp]) -> float:
    """Return the root of the mean over stays, each as heavy as any other."""
    means = [np.mean(squares[stay == number]) for number in np.unique(stay)]
    return float(np.sqrt(np.mean(means)))


if __name__ == "__main__":
    run(
        "Plate sweeps",
        asked,
        scored,
        Path("build/blind_sweep.jsonl"),
        about="A blade-element model of our own; nothing of the "
        "library's formulae. Nothing was chosen on scoring seeds.",
    )
