"""Plate sweeps in which something is hidden, with the truth beside them.

The physics is this folder's; nothing of benchtool is imported. One record is a sweep to learn from
and one to check on, of the same bench: other distances, levels, order and noise.
"""

from __future__ import annotations

import zlib
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from tests.proof.blind.families import (
    Dirt,
    Kind,
    Strength,
    families_of,
    hidden_names,
    kind_of,
    pairs_of,
)
from tests.proof.blind.pitch import seeds
from tests.proof.blind.sweep.bench import Bench
from tests.proof.blind.sweep.dirt import clean_bench, dirty_bench
from tests.proof.blind.sweep.layouts import LAYOUTS, Layout, LayoutName
from tests.proof.blind.sweep.library import NAMED, Hidden
from tests.proof.blind.sweep.model_text import model_text
from tests.proof.blind.sweep.outside import OUTSIDE, put_outside
from tests.proof.blind.sweep.programme import HABITS, Excitation, programme
from tests.proof.blind.sweep.table import Part, swept


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """Hold what is hidden in a record.

    Attributes:
        names: the hidden effects' names; an outside family's name is no library effect.
        effects: named effects with their parameters; none where nothing of the library is hidden.
    """

    family: str  # what was asked for
    kind: Kind  # named, none, pair or outside
    names: tuple[str, ...]
    effects: tuple[Hidden, ...]
    bench: Bench  # the true bench, every number of it
    seed: int  # of the record
    layout: LayoutName  # single or quad
    excitation: Excitation  # rich or poor
    strength: Strength  # full or weak
    dirt: Dirt  # dirty or clean
    imperfections: dict[str, object]  # every number that departs from the data sheet

    def keys(self) -> dict[str, object]:
        """Return the truth as plain values, for a file."""
        return asdict(self)


@dataclass(frozen=True, slots=True, eq=False)
class HiddenSweep:
    """Hold a record: what a user sees (learn, check, model file) and what is true."""

    learn: pd.DataFrame  # table to learn from, in the columns of a run's points.csv
    check: pd.DataFrame  # table of the same bench on another day
    truth: Truth  # what is hidden
    model_toml: str  # the bench's model file, tolerances stated
    parts: tuple[Part, Part]  # learn and check with what is true of every row, for scoring only


def families() -> dict[str, Kind]:
    """Return every family that can be asked for, with its kind.

    A pair can also be asked for by its names, as `plate_offset+tare_offset`.
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
    layout: LayoutName | None = None,
) -> HiddenSweep:
    """Make one record; the same arguments make the same record.

    Args:
        seed: for development or for scoring (`seeds.py`).
        family: one of `families()`, or two effects as `pairs()` spells them.
        excitation: rich or poor.
        strength: full effects are 2 to 8 tolerances, weak ones 0.3 to 1.5.
        dirt: whether everything else is slightly off.
        layout: what stands on the bench; drawn among those that show the effect when left out.
    """
    kind = kind_of(family, families())
    word = f"{family}/{excitation}/{strength}/{dirt}/{layout}"
    root = np.random.default_rng([zlib.crc32(word.encode()), seeds.checked(seed)])
    draw_bench, draw_hidden, *draw_parts = root.spawn(4)
    names = hidden_names(family, families(), draw_hidden)
    sheet = _layout(names, draw_hidden, layout)
    bench = dirty_bench(draw_bench, sheet) if dirt == "dirty" else clean_bench(sheet)
    effects = tuple(NAMED[name].hide(draw_hidden, sheet, strength) for name in names)
    for effect in effects:
        bench = NAMED[effect.name].put_into(bench, effect.size)
    if kind == "outside":
        bench = put_outside(family, draw_hidden, bench, strength)
    habit = int(draw_hidden.integers(len(HABITS)))
    learn, check = (
        swept(_on_another_day(bench, rng), programme(rng, sheet, excitation, habit), rng)
        for rng in draw_parts
    )
    truth = Truth(
        family=family,
        kind=kind,
        names=names or ((family,) if kind == "outside" else ()),
        effects=effects,
        bench=bench,
        seed=seed,
        layout=sheet.name,
        excitation=excitation,
        strength=strength,
        dirt=dirt,
        imperfections=bench.departures(),
    )
    return HiddenSweep(learn.table, check.table, truth, model_text(sheet, names), (learn, check))


def _layout(names: tuple[str, ...], rng: np.random.Generator, asked: str | None) -> Layout:
    able = [one for one in LAYOUTS if all(one in NAMED[name].layouts for name in names)]
    drawn = able[int(rng.integers(len(able)))]
    if asked is None:
        return LAYOUTS[drawn]
    if asked not in able:
        raise ValueError(f"{' and '.join(names)} cannot show on layout {asked!r}, only on {able}")
    return LAYOUTS[asked]


def _on_another_day(bench: Bench, rng: np.random.Generator) -> Bench:
    """Return the bench with its battery charged anew."""
    return replace(bench, full_V=bench.full_V * (1.0 + float(rng.uniform(-0.01, 0.01))))


def swept_again(record: HiddenSweep, count: int) -> tuple[Part, ...]:
    """Sweep a record's bench so often again, each time on another day and in another order."""
    truth = record.truth
    word = f"again/{truth.family}/{truth.excitation}/{truth.strength}/{truth.dirt}"
    root = np.random.default_rng([zlib.crc32(word.encode()), seeds.checked(truth.seed)])
    habit = int(root.integers(len(HABITS)))
    return tuple(
        swept(
            _on_another_day(truth.bench, rng),
            programme(rng, truth.bench.layout, truth.excitation, habit),
            rng,
        )
        for rng in root.spawn(count)
    )


def write_table(table: pd.DataFrame, path: Path) -> None:
    """Write a sweep as a run's `points.csv`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(path, index=False, float_format="%.9g", lineterminator="\n")


def write_record(record: HiddenSweep, folder: Path) -> tuple[Path, Path, Path]:
    """Write both tables and the model file; return their paths.

    The truth is not written: whoever scores makes the record again from its seed.
    """
    paths = []
    for name, table in (("learn", record.learn), ("check", record.check)):
        path = folder / name / "points.csv"
        write_table(table, path)
        paths.append(path)
    model = folder / "model.toml"
    model.write_text(record.model_toml, encoding="utf-8")
    return paths[0], paths[1], model
