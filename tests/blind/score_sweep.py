"""Score `benchtool explain` on plate sweeps with hidden effects, and print the scorecard.

`make blind` runs it on scoring seeds.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchtool.effects.catalogue import EFFECTS
from benchtool.explain.explain import explain
from benchtool.explain.sweep_subject import SweepSubject
from benchtool.explain.verdict import Verdict
from benchtool.library import load_model
from benchtool.store import read_points
from benchtool.store.columns import KINDS
from tests.blind.fisher import class_confirmed
from tests.blind.scored import Scored, ScoredParameter
from tests.blind.scoring import Asked, plan, run, sizes_needed
from tests.blind.sweep.information import information
from tests.blind.sweep.library import NAMED
from tests.blind.sweep.outside import OUTSIDE
from tests.blind.sweep.readings import cell_N
from tests.blind.sweep.records import HiddenSweep, make_record, write_record

PARTS = 20
"""Rich records of every named effect: 220 in all."""


def asked(first_seed: int, scale: float) -> Iterator[Asked]:
    """Yield what is scored."""
    return plan(NAMED, OUTSIDE, first_seed, parts=PARTS, scale=scale)


def verdict_on(record: HiddenSweep) -> tuple[Verdict, float]:
    """Return the verdict on a record as a user's files would give it, and how long it took: s."""
    with TemporaryDirectory() as folder:
        learn, check, model_file = write_record(record, Path(folder))
        model = load_model(model_file).model
        points = [read_points(path, KINDS) for path in (learn, check)]
    began = time.perf_counter()
    verdict = explain(SweepSubject(model, points[:1], points[1:])).verdict
    return verdict, time.perf_counter() - began


def scored(one: Asked) -> Scored:
    """Make a record and score the verdict on it."""
    record = make_record(one.seed, one.family, excitation=one.excitation, strength=one.strength)
    verdict, seconds = verdict_on(record)
    truth = record.truth
    hidden = {
        f"{effect.name}.{name}": value
        for effect in truth.effects
        for name, value in effect.parameters.items()
    }
    return Scored(
        kind=truth.kind,
        truth=truth.names,
        sizes=tuple(effect.size for effect in truth.effects),
        stage=EFFECTS[truth.names[0]].stage if truth.kind == "named" else "",
        verdict=verdict.kind,
        names=verdict.names,
        probabilities=dict(verdict.probabilities),
        where=verdict.where.stage if verdict.where is not None else "",
        not_judged=sizes_needed(verdict.not_judged),
        confirmed=verdict.kind == "class"
        and class_confirmed(
            verdict.names, truth.names, lambda: information(record.parts[0], truth.bench)
        ),
        gaps={gap.channel: gap.after / gap.floor for gap in verdict.gaps},
        true_gaps=_true_gaps(record, verdict),
        parameters=tuple(
            ScoredParameter(
                name=f"{effect.name}.{item.name}", value=item.value, low=item.low, high=item.high,
                truth=hidden[f"{effect.name}.{item.name}"],
            )
            for effect in verdict.effects
            for item in effect.parameters
            if f"{effect.name}.{item.name}" in hidden
        ),
        seconds=seconds,
        strength=one.strength,
        excitation=one.excitation,
        label=one.label,
    )  # fmt: skip


def _true_gaps(record: HiddenSweep, verdict: Verdict) -> dict[str, float]:
    """Return how far the true bench misses its own check sweep, over the stated floor."""
    part = record.parts[1]
    read = record.check["thrust_N"].to_numpy()
    missed = read - cell_N(part.bench, part.rows, part.force_N)[part.kept]
    floor = next(gap.floor for gap in verdict.gaps if gap.channel == "thrust_N")
    return {"thrust_N": float(np.sqrt(np.mean(missed**2))) / floor}


if __name__ == "__main__":
    run("Plate sweeps", asked, scored, Path("build/blind_sweep.jsonl"))
