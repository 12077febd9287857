"""What can be asked of a generator: one named effect, a pair, nothing, or one that has no name."""

from __future__ import annotations

import ast
import itertools
from collections.abc import Iterable
from pathlib import Path
from typing import Literal

import numpy as np

Dirt = Literal["dirty", "clean"]
Kind = Literal["named", "none", "pair", "outside"]
Stage = Literal["pwm_to_rpm", "rpm_to_thrust", "hinge", "sensor", "plate"]
Strength = Literal["full", "weak"]

RANGES: dict[Strength, tuple[float, float]] = {"full": (2.0, 8.0), "weak": (0.3, 1.5)}
"""Sizes in tolerances past the neutral value."""

NONE, PAIR = "none", "pair"  # families with nothing hidden, and with two named effects, drawn


def drawn_size(
    rng: np.random.Generator, strength: Strength, most_below: float, most_above: float
) -> float:
    """Draw a size in tolerances on a side that physics allows; negative ones lie below neutral."""
    low, high = RANGES[strength]
    sides = [side for side in (-1.0, 1.0) if (most_below, most_above)[side > 0] > 0]
    side = float(rng.choice(sides))
    return side * float(rng.uniform(low, min(high, most_above if side > 0 else most_below)))


def families_of(named: Iterable[str], outside: Iterable[str]) -> dict[str, Kind]:
    """Return every family that can be asked for, with its kind."""
    return {
        **dict.fromkeys(named, "named"),
        NONE: "none",
        PAIR: "pair",
        **dict.fromkeys(outside, "outside"),
    }


def pairs_of(named: Iterable[str]) -> tuple[str, ...]:
    """Return every pair of named effects, as it can be asked for: `cog_offset+motor_lag`."""
    return tuple("+".join(two) for two in itertools.combinations(named, 2))


def kind_of(family: str, known: dict[str, Kind]) -> Kind:
    """Return the kind of a family or of a pair of names, or say what there is."""
    if family in known:
        return known[family]
    names = family.split("+")
    if len(set(names)) == 2 and all(known.get(name) == "named" for name in names):
        return "pair"
    raise ValueError(f"there is no family {family!r}; there are {', '.join(known)}, and A+B")


def hidden_names(family: str, known: dict[str, Kind], rng: np.random.Generator) -> tuple[str, ...]:
    """Return the named effects that a family hides; a pair that is not spelled out is drawn."""
    kind = kind_of(family, known)
    if kind == "named":
        return (family,)
    if family == PAIR:
        named = [name for name, its in known.items() if its == "named"]
        return tuple(str(name) for name in rng.choice(named, 2, replace=False))
    return tuple(family.split("+")) if kind == "pair" else ()


def packages_imported(folder: Path) -> set[str]:
    """Return the packages that the modules of a folder import, wherever in them."""
    found: set[str] = set()
    for path in folder.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                found.add((node.module or "").split(".")[0])
    return found
