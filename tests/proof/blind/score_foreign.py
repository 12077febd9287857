"""Score `benchtool explain` on benches that were made elsewhere, and print the scorecard.

The generators stand beside the reference data, in `foreign/`: their physics, their noise and their
owners' mistakes are not ours. `make blind` runs it on the seeds kept for scoring.

python -m tests.proof.blind.score_foreign sweeps
"""

from __future__ import annotations

import json
import os
import runpy
import subprocess
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchtool.explain.inputs import ExplainInputs
from benchtool.explain.request import read_request
from tests.proof.blind.families import NONE
from tests.proof.blind.scored import Scored
from tests.proof.blind.scoring import Asked, run, score_answer

DEVELOPMENT, SCORING = range(500), range(500, 1000)

TOLERANCES = 2.0  # size of every hidden effect

NULLS, PAIRS, PARTS = 12, 3, 40
"""Records of each kind in one part of the plan; every named and every outside effect has one."""

ABOUT = {
    "sweeps": "Blade elements and smeared sources over a tilted, finite plate, written outside "
    "this project. Seeds 0 to 127 served development; nothing was chosen on seeds 500 to 999.",
    "pitch": "A rigid-body engine with friction, lag and ground laws in several published shapes, "
    "written outside this project. Seeds 0 to 111 served development; nothing was chosen on seeds "
    "500 to 999.",
}

SHAPES = {  # laws of the pitch bench for one effect, in turn
    "coulomb_friction": ("tanh", "dahl", "lugre", "stribeck"),
    "motor_lag": ("plain", "updown", "second"),
}


def generator(family: str) -> Path:
    """Return the generator of a family of benches."""
    data = os.environ.get("BENCHTOOL_REFERENCE_DATA", "")
    found = Path(data).parent / "foreign" / f"{family}.py"
    if not data or not found.is_file():
        raise SystemExit(f"no {found}: set BENCHTOOL_REFERENCE_DATA to the data beside foreign/")
    return found


def asked(family: str, first_seed: int, scale: float, _length: int = 0) -> Iterator[Asked]:
    """Yield what is scored: every kind in each part, so that a part of it is a fair sample."""
    known = _names(family)
    named, outside = list(known["LIBRARY"]), list(known["OUTSIDE"])
    seeds = SCORING if first_seed in SCORING else DEVELOPMENT
    number = first_seed
    for part in range(max(1, round(PARTS * scale))):
        shaped = [
            f"{name}:{shapes[part % len(shapes)]}" if shapes else name
            for name in named
            for shapes in [SHAPES.get(name, ()) if family == "pitch" else ()]
        ]
        pairs = [
            f"{named[(part + 2 * k) % len(named)]}+{named[(3 * part + 5 * k + 1) % len(named)]}"
            for k in range(PAIRS)
        ]
        for what in (*shaped, *outside, *pairs, *[NONE] * NULLS):
            if len(set(what.split("+"))) == len(what.split("+")):
                yield Asked(seeds[number % len(seeds)], what)
            number += 1


def _names(family: str) -> dict[str, Any]:
    """Return what a generator's module defines."""
    path = generator(family)
    sys.path.insert(0, str(path.parent))
    try:
        return runpy.run_path(str(path))
    finally:
        sys.path.remove(str(path.parent))


def scored(family: str, one: Asked) -> Scored:
    """Make a record and score the answer that its owner gets."""
    with TemporaryDirectory() as folder:
        command = [
            sys.executable, str(generator(family)), "--seed", str(one.seed),
            "--effect", one.family, "--size", str(TOLERANCES), "--out", folder,
        ]  # fmt: skip
        made = subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
        record = Path(made)
        truth = json.loads((record / "truth.json").read_text(encoding="utf-8"))
        began = time.process_time()
        files = (str(record / name) for name in ("learn.csv", "check.csv", "model.toml"))
        learn, check, model = files
        inputs = ExplainInputs(recordings=(learn,), check=(check,), model=model)
        verdict = read_request(inputs).explain()
        seconds = time.process_time() - began
    also_true = tuple(truth.get("also_true", ())) if truth["names"] else ()
    sizes = {name: truth["sizes"].get(name, TOLERANCES) for name in (*truth["names"], *also_true)}
    return score_answer(one, truth["kind"], sizes, verdict, seconds, truth["parameters"])


if __name__ == "__main__":
    family = sys.argv.pop(1) if len(sys.argv) > 1 else ""
    if family not in ("sweeps", "pitch"):
        raise SystemExit("name the benches: sweeps or pitch")
    run(
        f"Foreign {family}", partial(asked, family), partial(scored, family),
        Path(f"build/foreign_{family}.jsonl"), seeds=(DEVELOPMENT.start, SCORING.start),
        about=ABOUT[family],
    )  # fmt: skip
