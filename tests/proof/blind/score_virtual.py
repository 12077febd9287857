"""Score `benchtool explain` on the virtual benches that ship, and print the scorecard.

Everything is done by the command line, as a user does it: two runs, then `explain`. `make blind`
runs it on seeds that served nothing else.

python -m tests.proof.blind.score_virtual single
"""

from __future__ import annotations

import contextlib
import io
import sys
import time
from collections.abc import Iterator
from functools import partial
from importlib import resources
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal, NamedTuple

from benchtool.commands.app import main
from benchtool.explain.engine.evidence import (
    ScaledParameter,
    effect_parameters,
    with_every_effect,
)
from benchtool.explain.engine.explain import explain
from benchtool.explain.inputs import ExplainInputs
from benchtool.explain.request import read_request
from benchtool.physics.catalogue import candidates
from benchtool.physics.model_file import load_model
from tests.proof.blind.families import NONE
from tests.proof.blind.scored import Scored
from tests.proof.blind.scoring import Asked, run, score_answer

TOLERANCES = 4.0  # size of every hidden effect
NULLS = 12  # records with nothing hidden in one part of the plan; every effect has one

PARTS = 40

DEVELOPMENT, SCORING = 0, 20_000

REFUSED = {"tare_offset"}
"""Effects that no run can be recorded with: a sweep tares again, then refuses."""


class Bench(NamedTuple):
    """A virtual bench: its address, its truth, the model that lacks nothing, how it is recorded."""

    address: str
    truth: str
    model: str
    kind: Literal["sweep", "pitch"]
    learn: str
    check: str


BENCHES = {
    "single": Bench(
        "sim:pquad_single?rate=40", "virtual_pquad_single", "single", "sweep",
        "--z-over-r 0.6,0.8,1,1.5,2.5,4 --pwm 1400,1500,1600 --repeats 2",
        "--z-over-r 0.7,1.2,2,3 --pwm 1450,1550 --repeats 1",
    ),
    "quad": Bench(
        "sim:pquad?rate=40", "virtual_pquad", "quad_body_lift", "sweep",
        "--z-over-r 0.6,0.8,1,1.5,2.5,4 --pwm 1450,1550,1650 --repeats 2",
        "--z-over-r 0.7,1.2,2,3.5 --pwm 1500,1600 --repeats 1",
    ),
    "pitch": Bench(
        "sim:pquad?mode=pitch&schedule=identify", "pitch_pquad", "pitch_pquad", "pitch",
        "--seconds 40", "--seconds 30",
    ),
}  # fmt: skip


def hidden(bench: Bench) -> dict[str, ScaledParameter]:
    """Return what the truth can be given, by effect: its first number."""
    truth = load_model(bench.truth).model
    stated = {effect.name for effect in truth.effects}
    model = with_every_effect(truth, bench.kind)
    names = {effect.name for effect in candidates(bench.kind)} - stated - REFUSED
    found: dict[str, ScaledParameter] = {}
    for one in effect_parameters(model, bench.kind, ()):
        if one.effect in names:
            found.setdefault(one.effect, one)
    return found


def asked(name: str, first_seed: int, scale: float, _length: int = 0) -> Iterator[Asked]:
    """Yield what is scored: every kind in each part, so that a part of it is a fair sample."""
    effects = tuple(hidden(BENCHES[name]))
    seed = first_seed
    for _ in range(max(1, round(PARTS * scale))):
        for what in (*effects, *[NONE] * NULLS):
            yield Asked(seed, what)
            seed += 2


def scored(name: str, one: Asked) -> Scored:
    """Record two runs of a bench and score the answer that its owner gets."""
    bench = BENCHES[name]
    text = (resources.files("benchtool.library.models") / f"{bench.truth}.toml").read_text("utf-8")
    sizes, values = {}, {}
    if one.family != NONE:
        number = hidden(bench)[one.family]
        size = TOLERANCES if number.value(TOLERANCES) <= number.upper else -TOLERANCES
        sizes, values = {one.family: size}, {number.name: number.value(size)}
        parameter = number.name.removeprefix(f"{one.family}.")
        text += f"\n[effects.{one.family}]\n{parameter} = {number.value(size)!r}\n"
    with TemporaryDirectory() as folder, contextlib.chdir(folder):
        Path("truth.toml").write_text(text, encoding="utf-8")
        command = "sweep" if bench.kind == "sweep" else "record"
        for place, how in enumerate((bench.learn, bench.check)):
            address = f"{bench.address}&truth=truth.toml&seed={one.seed + place}"
            _type([command, address, *how.split(), "--yes", "--out", f"run{place}"])
        began = time.process_time()
        inputs = ExplainInputs(recordings=("run0",), check=("run1",), model=bench.model)
        request = read_request(inputs)
        verdict = explain(request.subject(), propose=False)
        seconds = time.process_time() - began
    return score_answer(one, "named" if sizes else "none", sizes, verdict, seconds, values)


def _type(words: list[str]) -> None:
    """Do what a command does.

    Raises:
        RuntimeError: it ended with an exit code.
    """
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            main(words)
        except SystemExit as end:
            if end.code:
                raise RuntimeError(f"{words}: {said.getvalue()}") from end


if __name__ == "__main__":
    name = sys.argv.pop(1) if len(sys.argv) > 1 else ""
    if name not in BENCHES:
        raise SystemExit(f"name the bench: {', '.join(BENCHES)}")
    run(
        f"Virtual bench {name}", partial(asked, name), partial(scored, name),
        Path(f"build/virtual_{name}.jsonl"), seeds=(DEVELOPMENT, SCORING),
        about="A virtual bench that ships, recorded and explained as a user does it. Every hidden "
        "effect is four times its tolerance; its bench shares the library's laws.",
    )  # fmt: skip
