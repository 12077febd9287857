"""Choose runs by rig, propeller, date, operator, distance, tag, how they ended, and words."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime
from math import inf
from pathlib import Path
from typing import Annotated

from annotated_types import Ge

from benchtool.core.errors import InputError
from benchtool.core.inputs import Input, Inputs
from benchtool.data.catalogue.entry import Entry, EntryKind


@dataclass(frozen=True, slots=True, kw_only=True)
class ChoiceInputs(Inputs):
    """What chooses entries of a catalogue; nothing given chooses all."""

    folder: Annotated[tuple[Path, ...], Input("Folder of runs; repeatable.")] = (Path("runs"),)
    words: Annotated[str, Input("Words in name, rig, date, tags, notes.", group="Filter")] = ""
    kind: Annotated[EntryKind | None, Input("Kind of entry.", default_text="any")] = None
    rig: Annotated[str, Input("Rig of a run, model of a fit.")] = ""
    propeller: Annotated[str, Input("Propeller of the rig.")] = ""
    operator: Annotated[str, Input("Operator.")] = ""
    since: Annotated[str, Input("First day, e.g. 2026-03-01.")] = ""
    until: Annotated[str, Input("Last day, e.g. 2026-03-31.")] = ""
    z_over_r: Annotated[
        tuple[Annotated[float, Ge(0.0)], Annotated[float, Ge(0.0)]] | None,
        Input("Range of z/R, e.g. 0.5,1."),
    ] = None
    tag: Annotated[tuple[str, ...], Input("Required tags.", comma_separated=True)] = ()
    state: Annotated[
        str,
        Input("State of a run, outcome of a fit or verdict of an explanation."),
    ] = ""
    fitted: Annotated[
        tuple[str, ...],
        Input("Fitted parameter, optionally with range: body_lift.K_b=1.8..2.1."),
    ] = ()


def filter_entries(entries: Iterable[Entry], by: ChoiceInputs) -> tuple[Entry, ...]:
    """Return the entries that match everything that is given, in their order."""
    since, until = _day(by.since, "since"), _day(by.until, "until")
    low, high = by.z_over_r or (0.0, inf)
    if low > high:
        raise InputError(f"z-over-r is {low:g} to {high:g}; give the smaller one first")
    fitted = [_limits(text) for text in by.fitted]
    exact = {
        name: value.lower()
        for name in ("kind", "rig", "propeller", "operator", "state")
        if (value := getattr(by, name))
    }
    return tuple(
        entry
        for entry in entries
        if all(getattr(entry, name).lower() == value for name, value in exact.items())
        and (not since or (entry.date[:10] >= since))
        and (not until or ("" < entry.date[:10] <= until))
        and (
            by.z_over_r is None
            or (entry.z_over_r and entry.z_over_r[0] <= high and entry.z_over_r[1] >= low)
        )
        and set(by.tag) <= set(entry.tags)
        and all(_lies(entry, *one) for one in fitted)
        and (not by.words or entry.matches(by.words))
    )


def find_entries(by: ChoiceInputs, *, rebuild: bool = False) -> list[tuple[Path, Entry]]:
    """Return the chosen entries of all folders, each with its path.

    Raises:
        InputError: a folder that is not there, or values that choose nothing by themselves.
    """
    from benchtool.data.catalogue.index import catalogued

    found = []
    for root in by.folder:
        if not root.is_dir():
            raise InputError(f"there is no folder {root}; name a folder of runs")
        entries = filter_entries(catalogued(root, rebuild=rebuild), by)
        found += [(root / entry.name, entry) for entry in entries]
    return found


def _limits(text: str) -> tuple[str, float, float]:
    """Return name and limits of a fitted parameter, typed as NAME or NAME=LOW..HIGH."""
    name, given, limits = text.partition("=")
    low, _, high = limits.partition("..")
    try:
        found = (float(low), float(high)) if given else (-inf, inf)
    except ValueError:
        found = (1.0, 0.0)
    if not name or not found[0] <= found[1]:
        raise InputError(
            f"fitted is {text!r}; give a parameter, or one with two limits, the smaller first: "
            f"body_lift.K_b=1.8..2.1"
        )
    return name, *found


def _lies(entry: Entry, name: str, low: float, high: float) -> bool:
    return any(
        (known == name or known.endswith(f".{name}")) and low <= value <= high
        for known, value in entry.values
    )


def _day(text: str, called: str) -> str:
    if not text:
        return ""
    try:
        return f"{datetime.strptime(text, '%Y-%m-%d').date()}"  # noqa: DTZ007
    except ValueError:
        raise InputError(f"{called} is {text!r}; give a day, as 2026-03-31") from None
