"""Gains by the names that a command line takes: one gain, or a factor on a whole table."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

from benchtool.core.errors import UnknownChoice
from benchtool.simulate.gain_file import Gains


def changed_gains(gains: Gains, name: str, value: float) -> Gains:
    """Return the set with one gain at a value ("attitude.k_q_per_s"), or a table's times a factor.

    A factor ("attitude") acts on the gains of its table and leaves limits alone.
    """
    tables = {
        item.name: getattr(gains, item.name)
        for item in fields(gains)
        if is_dataclass(getattr(gains, item.name))
    }
    if name in tables:
        scaled = {
            f"{name}.{each}": value * getattr(tables[name], each)
            for each in _numbers_of(tables[name])
            if each.startswith("k_") or each == "rate_per_s"
        }
        return gains.with_values(**scaled)
    table, _, single = name.partition(".")
    if not single and name != "control_rate_Hz":
        raise UnknownChoice("table of gains", name, [*tables, "control_rate_Hz"])
    if single and table not in tables:
        raise UnknownChoice("table of gains", table, tables)
    if single and single not in _numbers_of(tables[table]):
        raise UnknownChoice(f"gain of {table}", single, _numbers_of(tables[table]))
    return gains.with_values(**{name: value})


def _numbers_of(table: Any) -> list[str]:
    return [item.name for item in fields(table)]
