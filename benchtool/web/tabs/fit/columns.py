"""Which column of an uploaded table is which of our channels: guessed, and chosen. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from benchtool.core.channel import unit_told_by
from benchtool.core.column_source import ColumnSource
from benchtool.core.errors import InputError
from benchtool.core.units import UNITS, unit_named
from benchtool.data.csv_text import read_csv_text
from benchtool.data.repairs.foreign_units import head_of
from benchtool.data.repairs.mapped import channel_meant
from benchtool.data.run.runs_folder import columns_file
from benchtool.physics.model_file import read_columns

FIT_CHANNELS: tuple[str, ...] = (
    "thrust_N",
    "thrust_se_N",
    "thrust_sd_N",
    "plate_z_m",
    "rpm1",
    "rpm2",
    "rpm3",
    "rpm4",
    "pwm1_us",
    "plate_tilt_deg",
    "plate_x_m",
    "coverage1",
    "voltage_V",
    "time_s",
)
"""Channels that a fit uses, as docs/how-to/fit-your-csv.md lists them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnLine:
    """Hold one line of the form.

    Attributes:
        channel: ours.
        column: theirs; empty where the table has none.
        constant: for every row, where there is no column; None for neither.
        unit: of their numbers.
        reversed: whether their axis points the other way.
    """

    channel: str
    column: str = ""
    constant: float | None = None
    unit: str = ""
    reversed: bool = False


def units_for(channel: str) -> tuple[str, ...]:
    """Return the units that a column of a channel may have, ours first."""
    own = unit_told_by(channel)
    dimension = unit_named(own).dimension
    others = (symbol for symbol, unit in UNITS.items() if unit.dimension == dimension)
    return (own, *(symbol for symbol in others if symbol != own))


def lines_for(table: Path) -> tuple[ColumnLine, ...]:
    """Return the form of a table as it was stored, or else as its header suggests."""
    stored = columns_file(table)
    known = read_columns(stored) if stored.is_file() else guessed(read_csv_text(table).header)
    return tuple(_line(channel, known.get(channel)) for channel in FIT_CHANNELS)


def guessed(header: Sequence[str]) -> dict[str, ColumnSource]:
    """Return the channels that column names suggest, with the units in brackets."""
    found: dict[str, ColumnSource] = {}
    for cell in header:
        head = head_of(cell)
        channel = channel_meant(head.name)
        if channel in FIT_CHANNELS and channel not in found:
            fits = head.unit in units_for(channel)
            found[channel] = ColumnSource(column=cell, unit=head.unit if fits else None)
    return found


def columns_of(lines: Iterable[ColumnLine]) -> dict[str, ColumnSource]:
    """Return the map of a filled form.

    Raises:
        InputError: no thrust, or neither speed nor pulse width of rotors.
    """
    columns: dict[str, ColumnSource] = {}
    for line in lines:
        unit = line.unit if line.unit and line.unit != unit_told_by(line.channel) else None
        sign: Literal[-1, 1] = -1 if line.reversed else 1
        if line.column:
            columns[line.channel] = ColumnSource(column=line.column, unit=unit, sign=sign)
        elif line.constant is not None:
            columns[line.channel] = ColumnSource(constant=line.constant, unit=unit, sign=sign)
    if "thrust_N" not in columns:
        raise InputError("no column is thrust_N; choose the one with the thrust")
    if not {"rpm1", "pwm1_us"} & set(columns):
        raise InputError(
            "neither rpm1 nor pwm1_us has a column; choose one with rotor speed or pulse width, or "
            "give rpm1 one number for all rows"
        )
    return columns


def _line(channel: str, source: ColumnSource | None) -> ColumnLine:
    own = unit_told_by(channel)
    if source is None:
        return ColumnLine(channel=channel, unit=own)
    return ColumnLine(
        channel=channel,
        column=source.column or "",
        constant=source.constant,
        unit=source.unit or own,
        reversed=source.sign < 0,
    )
