"""Score many records: what is asked for, what was scored before, the command that does it.

Every record's outcome is kept in a file, so that a run that was cut short goes on where it was.
"""

from __future__ import annotations

import argparse
import datetime as dt
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from benchtool.core.units import Array
from benchtool.explain.result import Explanation
from benchtool.physics.catalogue import EFFECTS
from benchtool.tasks import TaskStore, run_tasks
from tests.proof.blind.families import NONE, PAIR
from tests.proof.blind.fisher import Telling, class_confirmed
from tests.proof.blind.pitch.seeds import DEVELOPMENT_SEEDS, SCORING_SEEDS, SCORING_SWITCH
from tests.proof.blind.scorecard import Scorecard
from tests.proof.blind.scored import (
    GAP_REACHED,
    MOST_MEMBERS,
    Excitation,
    Kind,
    Scored,
    ScoredParameter,
    Strength,
)

SCORING_BLOCK = 4
"""Which scoring seeds: raised whenever a threshold of the method changes, so that no version is
counted on seeds whose counts were known when it was made."""

SEEDS_OF_A_BLOCK = 10_000

FIRST_DEVELOPMENT_SEED = 2000  # seeds below were looked at while the method was written


@dataclass(frozen=True, slots=True)
class Asked:
    """Ask for one record; `length` times as much to learn from, and to check on, as usual."""

    seed: int
    family: str
    strength: Strength = "full"
    excitation: Excitation = "rich"
    length: int = 1

    @property
    def label(self) -> str:
        """Find the record again by this."""
        longer = f" x{self.length}" if self.length > 1 else ""
        return f"{self.family} {self.strength} {self.excitation} {self.seed}{longer}"


def plan(
    named: Iterable[str],
    outside: Iterable[str],
    first_seed: int,
    *,
    parts: int = 16,
    scale: float = 1.0,
) -> Iterator[Asked]:
    """Yield what is scored: every kind in turn, so that a part of it is a fair sample."""

    def count(full: int) -> int:
        return max(1, round(full * scale))

    seed = first_seed
    for part in range(count(parts)):
        for name in named:
            yield Asked(seed, name)
            if part % 8 < 3:
                yield Asked(seed, name, excitation="poor")
            if part % 8 < 3:
                yield Asked(seed, name, strength="weak")
        for k in range(count(19)):
            yield Asked(seed + k, NONE)
        for name in outside:
            if part % 8 < 5:
                yield Asked(seed, name)
        for k in range(3):
            yield Asked(seed + k, PAIR)
        seed += 20


def single_effects(
    named: Iterable[str], first_seed: int, length: int, *, parts: int = 16, scale: float = 1.0
) -> Iterator[Asked]:
    """Yield rich records of every named effect, for what their length does to the gap."""
    names = tuple(named)
    for part in range(max(1, round(parts * scale))):
        for name in names:
            yield Asked(first_seed + 20 * part, name, length=length)


def as_stored(scored: Callable[[Asked], Scored], scoring: bool, one: Asked) -> dict[str, Any]:
    """Return a record's outcome as JSON holds it; scoring seeds are used where that is wanted."""
    if scoring:
        os.environ[SCORING_SWITCH] = "1"
    return asdict(scored(one))


def as_scored(data: Mapping[str, Any]) -> Scored:
    """Return the outcome that was stored so."""
    found = dict(data)
    found["parameters"] = tuple(ScoredParameter(**one) for one in data["parameters"])
    for name in ("truth", "sizes", "names"):
        found[name] = tuple(data[name])
    return Scored(**found)


def within(draws: Mapping[str, Array], floors: Mapping[str, Array], reach: float) -> float:
    """Return the share of draws (n,) that no channel has above `reach` medians of its floor.

    What a count of gaps over many recordings comes to by luck alone, or by luck and what was not
    learned.
    """
    worst = np.max([draws[name] / np.median(floors[name]) for name in draws], axis=0)
    return float(np.mean(worst <= reach))


class Truth(Protocol):
    """What the truths of both benches have in common."""

    @property
    def kind(self) -> Kind: ...
    @property
    def names(self) -> tuple[str, ...]: ...
    @property
    def effects(self) -> Sequence[Any]: ...


def score(
    one: Asked,
    truth: Truth,
    found: Explanation,
    seconds: float,
    hidden: Mapping[str, float],
    information: Callable[[], Telling],
    **more: Any,
) -> Scored:
    """Lay the verdict on a record beside what is true of it.

    Args:
        one: what was asked for.
        truth: of the record.
        found: explanation of the record.
        seconds: that it took.
        hidden: true values of the hidden effects' parameters, `effect.parameter`.
        information: works out what the record tells about its true model.
        more: fields of `Scored` that only one of the benches has, or that it works out otherwise.
    """
    luck, learning = (
        within(draws, found.floors, GAP_REACHED)
        for draws in (found.floors, found.floors_as_learned)
    )
    # What is outside has a name and no effects with sizes.
    known = score_answer(one, truth.kind, dict.fromkeys(truth.names, 0.0), found, seconds, hidden)
    return replace(
        known,
        sizes=tuple(effect.size for effect in truth.effects),
        gaps={gap.channel: gap.after / gap.floor for gap in found.gaps},
        confirmed=found.kind == "class" and class_confirmed(found.names, truth.names, information),
        by_luck=luck,
        by_learning=learning,
        **more,
    )


def score_answer(
    one: Asked,
    kind: Kind,
    sizes: Mapping[str, float],
    verdict: Explanation,
    seconds: float,
    hidden: Mapping[str, float],
) -> Scored:
    """Lay an answer beside what is true of a bench whose Fisher information nobody has.

    Args:
        one: what was asked for.
        kind: of the truth.
        sizes: of what is hidden in tolerances, by name; the first one's stage counts.
        verdict: what the owner of the bench is answered.
        seconds: that it took.
        hidden: true values of the hidden effects' parameters, `effect.parameter`.
    """
    named = [name for name in sizes if name in EFFECTS]
    return Scored(
        kind=kind,
        truth=tuple(sizes),
        sizes=tuple(sizes.values()),
        stage=EFFECTS[named[0]].subsystem if kind == "named" else "",
        verdict=verdict.kind,
        names=verdict.names,
        probabilities=dict(verdict.probabilities),
        where=verdict.where.stage if verdict.where is not None else "",
        gaps={gap.channel: gap.after / gap.floor for gap in verdict.gaps if gap.floor},
        seconds=seconds,
        not_judged={name: needed.size for name, needed in verdict.not_judged.items()},
        confirmed=len(verdict.names) <= MOST_MEMBERS,
        parameters=scored_parameters(verdict, hidden),
        strength=one.strength,
        excitation=one.excitation,
        label=one.label,
    )


def scored_parameters(
    verdict: Explanation, hidden: Mapping[str, float]
) -> tuple[ScoredParameter, ...]:
    """Return the numbers of named effects whose true values, `effect.parameter`, are known."""
    return tuple(
        ScoredParameter(
            name=name, value=item.value, low=item.low, high=item.high, truth=hidden[name]
        )
        for effect in verdict.effects
        for item in effect.parameters
        if (name := f"{effect.name}.{item.name}") in hidden
    )


def run(
    title: str,
    asked: Callable[[int, float, int], Iterable[Asked]],
    scored: Callable[[Asked], Scored],
    kept: Path,
    *,
    about: str,
    seeds: tuple[int, int] = (
        DEVELOPMENT_SEEDS.start + FIRST_DEVELOPMENT_SEED,
        SCORING_SEEDS.start + SCORING_BLOCK * SEEDS_OF_A_BLOCK,
    ),
) -> None:
    """Score what the command line asks for, print, and write the page when asked.

    Args:
        title: of the scorecard.
        asked: asked(first seed, scale, length) yields the records: with a length rich ones of
            single effects only.
        scored: makes a record and scores the verdict on it; runs in processes of its own.
        kept: file of outcomes, when the command line names none.
        about: whose physics the records have, and what was chosen on them.
        seeds: the first for development, and the first for scoring.
    """
    parser = argparse.ArgumentParser(description=title)
    parser.add_argument("--scoring", action="store_true", help="scoring seeds, not development's")
    parser.add_argument("--scale", type=float, default=1.0, help="part of the records to make")
    parser.add_argument(
        "--length", type=int, default=0,
        help="rich records of single effects only, 1 of the usual length, 2 with twice as much to "
        "learn from and to check on",
    )  # fmt: skip
    parser.add_argument("--workers", type=int, default=None, help="processes; one for each core")
    parser.add_argument("--cluster", help="address of a Dask scheduler whose workers score")
    parser.add_argument("--kept", type=Path, default=kept)
    parser.add_argument("--page", type=Path, default=None, help="Markdown file to write")
    given = parser.parse_args()
    first = seeds[given.scoring]
    tasks = {one.label: one for one in asked(first, given.scale, given.length)}
    done: list[Scored] = []
    with TaskStore(given.kept, {"title": title}) as store:
        results = run_tasks(
            partial(as_stored, scored, given.scoring), tasks,
            store=store, cluster=given.cluster, processes=given.workers,
        )  # fmt: skip
        for _, data in results:
            done.append(as_scored(data))
            if len(done) % 20 == 0:
                print(f"{len(done)} of {len(tasks)}", flush=True)
    card = Scorecard(title, done, about)
    print(card.text())
    if given.page is not None:
        today = dt.datetime.now(tz=dt.UTC).date().isoformat()
        given.page.write_text(card.markdown(today), encoding="utf-8")
