"""Records of a pitch bench in which something is hidden, with the truth beside them.

The physics is MuJoCo's and this folder's; nothing of benchtool is imported. One record is a part to
learn from and a part to check on, of the same bench.
"""

from __future__ import annotations

import json
import zlib
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from tests.proof.blind.families import (
    Dirt,
    Kind,
    Stage,
    Strength,
    families_of,
    hidden_names,
    kind_of,
    pairs_of,
)
from tests.proof.blind.pitch import seeds
from tests.proof.blind.pitch.dirt import clean_bench, dirty_bench
from tests.proof.blind.pitch.library import NAMED, Hidden
from tests.proof.blind.pitch.loop import Part, TurnedOver, closed_loop
from tests.proof.blind.pitch.outside import OUTSIDE, STAGES, put_outside
from tests.proof.blind.pitch.plant import Plant
from tests.proof.blind.pitch.programme import Excitation, habits, programme
from tests.proof.blind.pitch.sheet import SHEET

NUMBER = "%.7g"

ATTEMPTS = 5
"""Benches drawn for one record at most. One is enough but for the odd pair of great effects."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """Hold what is hidden in a record.

    Attributes:
        names: the hidden effects' names; an outside family's name is no library effect.
        effects: named effects with their values; none where nothing of the library is hidden.
    """

    family: str  # what was asked for
    kind: Kind  # named, none, pair or outside
    names: tuple[str, ...]
    stages: tuple[Stage, ...]  # where each of them acts
    effects: tuple[Hidden, ...]
    plant: Plant  # the true model, every number of it
    seed: int  # of the record
    excitation: Excitation  # rich or poor
    strength: Strength  # full or weak
    dirt: Dirt  # dirty or clean
    imperfections: dict[str, object]  # every number that departs from the data sheet's ideal bench
    attempt: int  # how many benches were drawn before that turned over or touched the plate

    def keys(self) -> dict[str, object]:
        """Return the truth as plain values, for a file."""
        return asdict(self)


@dataclass(frozen=True, slots=True, eq=False)
class HiddenRecord:
    """Hold a record: what a user sees (learn, check, bench) and what is true."""

    learn: pd.DataFrame  # table to learn from, in the columns of the format
    check: pd.DataFrame  # table of the same bench with another reference and noise
    truth: Truth  # what is hidden
    bench: dict[str, float]  # the data sheet, in the keys of `bench.json`
    parts: tuple[Part, Part]  # learn and check with the true states of every row, for scoring only


def families() -> dict[str, Kind]:
    """Return every family that can be asked for, with its kind.

    A pair can also be asked for by its names, as `cog_offset+motor_lag`.
    """
    return families_of(NAMED, OUTSIDE)


def pairs() -> tuple[str, ...]:
    """Return every pair of named effects, as it can be asked for."""
    return pairs_of(NAMED)


def make_record(
    seed: int,
    family: str,
    *,
    excitation: Excitation,
    strength: Strength = "full",
    dirt: Dirt = "dirty",
    blocks: int = 1,
) -> HiddenRecord:
    """Make one record; the same arguments make the same record.

    Args:
        seed: for development or for scoring (`seeds.py`).
        family: one of `families()`, or two effects as `pairs()` spells them.
        excitation: rich or poor.
        strength: full effects are 2 to 8 tolerances, weak ones 0.3 to 1.5.
        dirt: whether everything else is slightly off.
        blocks: length of each part in units of 30 s.
    """
    kind = kind_of(family, families())
    asked = Asked(seeds.checked(seed), family, kind, excitation, strength, dirt, blocks)
    for attempt in range(ATTEMPTS):
        record = _attempt(asked, attempt)
        if record is not None:
            return record
    raise TurnedOver(f"{ATTEMPTS} benches drawn for {asked} cannot be run")


@dataclass(frozen=True, slots=True)
class Asked:
    """Hold the arguments of one record."""

    seed: int
    family: str
    kind: Kind
    excitation: Excitation
    strength: Strength
    dirt: Dirt
    blocks: int

    def generators(self, attempt: int) -> list[np.random.Generator]:
        """Return generators for bench, hidden thing, habits, learn and check part."""
        asked = (self.family, self.excitation, self.strength, self.dirt, self.blocks)
        word = "/".join(str(part) for part in asked)
        root = np.random.default_rng([zlib.crc32(word.encode()), self.seed, attempt])
        return root.spawn(5)


def _attempt(asked: Asked, attempt: int) -> HiddenRecord | None:
    """Draw a bench and run it; None where nobody would keep the recording."""
    draw_bench, draw_hidden, draw_habits, *draw_parts = asked.generators(attempt)
    plant = dirty_bench(draw_bench) if asked.dirt == "dirty" else clean_bench()
    names = hidden_names(asked.family, families(), draw_hidden)
    effects = tuple(NAMED[name].hide(draw_hidden, asked.strength) for name in names)
    stages = tuple(NAMED[name].stage for name in names)
    for effect in effects:
        plant = NAMED[effect.name].put_into(plant, effect.value)
    if asked.kind == "outside":
        plant = put_outside(asked.family, draw_hidden, plant, asked.strength)
        names, stages = (asked.family,), (STAGES[asked.family],)
    shared = habits(draw_habits, asked.excitation)
    try:
        learn, check = (
            closed_loop(plant, programme(rng, asked.excitation, shared, asked.blocks), rng)
            for rng in draw_parts
        )
    except TurnedOver:
        return None
    if learn.capped or check.capped:
        return None
    truth = Truth(
        family=asked.family,
        kind=asked.kind,
        names=names,
        stages=stages,
        effects=effects,
        plant=plant,
        seed=asked.seed,
        excitation=asked.excitation,
        strength=asked.strength,
        dirt=asked.dirt,
        imperfections=plant.departures(),
        attempt=attempt,
    )
    return HiddenRecord(learn.table, check.table, truth, SHEET.keys(), (learn, check))


def write_record(record: HiddenRecord, folder: Path, name: str) -> tuple[Path, Path]:
    """Write both tables and, once per folder, the bench; return the tables' paths.

    The truth is not written: whoever scores makes the record again from its seed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    bench = json.dumps(record.bench, indent=1)
    (folder / "bench.json").write_text(bench, encoding="utf-8")
    paths = folder / f"{name}.csv", folder / f"{name}_check.csv"
    for path, table in zip(paths, (record.learn, record.check), strict=True):
        table.to_csv(path, index=False, float_format=NUMBER, lineterminator="\n")
    return paths
