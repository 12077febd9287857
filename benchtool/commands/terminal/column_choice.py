"""Find out what the columns of somebody's table are: by options, by their names, by questions."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import nan
from pathlib import Path
from typing import Any

import numpy as np

from benchtool.commands.recipe_options import TableInputs
from benchtool.commands.terminal.questions import ask
from benchtool.core.column_source import ColumnSource
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.rig import Rig
from benchtool.data.column_map import IN_RADII, guess_columns, name_and_unit
from benchtool.data.csv_text import CsvTable, read_csv_text
from benchtool.data.repairs.foreign_units import conversion
from benchtool.data.table import Where, rows_where

NONE = "none"


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnChoice:
    """Hold what was found out about a table.

    Attributes:
        columns: where each channel stands.
        runs: values of the column that names runs, to be fitted one by one; empty for one fit.
        run_column: its name.
        notes: what a user should know of it.
    """

    columns: Mapping[str, ColumnSource]
    runs: tuple[str, ...] = ()
    run_column: str = ""
    notes: tuple[str, ...] = ()

    @property
    def has_ratios(self) -> bool:
        """Whether there are ratios in place of thrusts."""
        return "thrust_ratio" in self.columns


def choose_columns(
    path: str, given: TableInputs, rig: Rig, where: Sequence[str] = ()
) -> ColumnChoice:
    """Return what the columns of a table are.

    Raises:
        InputError: something is open and nobody is at a terminal, or a column that is not there.
    """
    whole = read_csv_text(Path(path))
    filters = [Where.parse(text) for text in where]
    chooser = _Chooser(replace(whole, rows=[whole.rows[row] for row in rows_where(whole, filters)]))
    chooser.given, chooser.rig, chooser.where = given, rig, where
    return chooser.choose()


class _Chooser:
    """Work through one table."""

    given: TableInputs
    rig: Rig
    where: Sequence[str]

    def __init__(self, table: CsvTable) -> None:
        self.table, self.header = table, [cell for cell in table.header if cell]
        self.columns: dict[str, ColumnSource] = {}
        self.notes: list[str] = []

    def choose(self) -> ColumnChoice:
        known = guess_columns(self.header, radius_m=self.rig.propulsion.radius_m)
        self._thrust(known)
        self._distance(known)
        self._reference()
        self._speed(known)
        self._error()
        for name in ("time_s", "voltage_V", "current_A", "torque_Nm", "power_W"):
            if name in known and name not in self.columns:
                self.columns[name] = known[name]
        run_column, runs = self._runs()
        return ColumnChoice(
            columns=self.columns, runs=runs, run_column=run_column, notes=tuple(self.notes)
        )

    def column(self, name: str, option: str) -> str:
        """Return the column that an option names, with or without its unit, in any case."""
        if name in self.header:
            return name
        folded = name.casefold()
        alike = [cell for cell in self.header if name_and_unit(cell)[0].casefold() == folded]
        if len(alike) != 1:
            raise UnknownChoice(f"column for {option} in {self.table.where}", name, self.header)
        return alike[0]

    def _asked(self, what: str, option: str, *, usual: str = "") -> str:
        """Return the column that somebody names; empty for none."""
        listed = ", ".join(self.header)
        reason = f"{self.table.where}: no column's name says {what} (columns: {listed})"
        typed = ask(f"{what} (columns: {listed})", option, usual=usual, reason=reason)
        return "" if typed == NONE else self.column(typed, option)

    def _unit(self, cell: str, stated: str, option: str, own: str) -> str | None:
        """Return the unit to write for a column: stated, in its name, or asked with ours offered.

        None where the column's own name or our unit says it.
        """
        in_name = name_and_unit(cell)[1]
        if stated:
            conversion(stated, own)
            return stated
        if in_name is not None:
            return in_name
        import sys

        if sys.stdin.isatty():
            unit = ask(f"Unit of {cell}", option, usual=own)
            conversion(unit, own)
            return None if unit == own else unit
        self.notes.append(f"{cell!r} names no unit and is read in {own} ({option} says another)")
        return None

    def _thrust(self, guess: Mapping[str, ColumnSource]) -> None:
        given = self.given
        if given.ratio and given.thrust:
            raise InputError("--thrust and --ratio are both given; give one of them")
        if given.ratio:
            self.columns["thrust_ratio"] = ColumnSource(column=self.column(given.ratio, "--ratio"))
            return
        if not given.thrust and "thrust_N" not in guess and "thrust_ratio" in guess:
            self.columns["thrust_ratio"] = guess["thrust_ratio"]
            return
        cell = self.column(given.thrust, "--thrust") if given.thrust else ""
        if not cell and "thrust_N" in guess:
            cell = guess["thrust_N"].column or ""
        cell = cell or self._asked("which is the thrust", "--thrust COLUMN (or --ratio COLUMN)")
        if not cell:
            raise InputError("without a thrust there is nothing to fit; give --thrust or --ratio")
        unit = self._unit(cell, given.unit, "--unit", "N")
        self.columns["thrust_N"] = ColumnSource(column=cell, unit=unit)

    def _distance(self, guess: Mapping[str, ColumnSource]) -> None:
        given = self.given
        if given.z == NONE:
            return
        if not given.z and "plate_z_m" in guess and not given.z_unit:
            source = guess["plate_z_m"]
            if source.unit is not None or source.factor != 1.0:
                self.columns["plate_z_m"] = source
                return
            cell = source.column or ""
        elif not given.z and "plate_z_m" in guess:
            cell = guess["plate_z_m"].column or ""
        else:
            what = "which is the plate's distance"
            cell = (
                self.column(given.z, "--z")
                if given.z
                else self._asked(what, "--z COLUMN (or --z none without a plate)", usual=NONE)
            )
        if not cell:
            return
        radius_m, radii = self.rig.propulsion.radius_m, {"R": 1.0, "D": 2.0}
        counted_in = IN_RADII.get(name_and_unit(cell)[0].lower()) if not given.z_unit else None
        if counted_in is not None:
            self.columns["plate_z_m"] = ColumnSource(column=cell, factor=counted_in * radius_m)
            return
        if (unit := given.z_unit.upper()) in radii:
            self.columns["plate_z_m"] = ColumnSource(column=cell, factor=radii[unit] * radius_m)
            return
        in_file = self._unit(cell, given.z_unit, "--z-unit", "m")
        self.columns["plate_z_m"] = ColumnSource(column=cell, unit=in_file)
        nearest = float(np.nanmin(self._numbers(cell), initial=nan)) / radius_m
        if in_file is None and nearest > FARTHEST:
            raise InputError(
                f"{self.table.where}: the nearest distance in {cell!r}, read in m, is "
                f"{nearest:.3g} rotor radii, where there is no ground effect; give its unit with "
                f"--z-unit (mm, cm, in, R for rotor radii)"
            )

    def _reference(self) -> None:
        source = self.columns.get("plate_z_m")
        if self.given.reference:
            named = Where.parse(self.given.reference)
            cell, value = self.column(named.column, "--reference"), named.value
            if not rows_where(self.table, [Where(cell, value)]):
                raise InputError(f"no row has {cell}={value}; correct --reference")
        elif source is not None and source.column is not None:
            cell = source.column
            texts = set(self._texts(cell)) - {""}
            words = sorted(text for text in texts if not _is_number(text))
            if not words:
                return
            if len(words) > 1 or words[0].casefold() not in FAR:
                raise InputError(
                    f"{self.table.where}: column {cell!r} holds {words[0]!r} among its distances; "
                    f"mend it, or name the rows far from the plate with --reference COLUMN=VALUE"
                )
            value = words[0]
        else:
            return
        self.columns["kind"] = ColumnSource(column=cell, reference=value)

    def _speed(self, guess: Mapping[str, ColumnSource]) -> None:
        if self.given.rpm and self.given.rpm != NONE:
            try:
                self.columns["rpm1"] = ColumnSource(constant=float(self.given.rpm), unit="rpm")
            except ValueError:
                cell = self.column(self.given.rpm, "--rpm")
                unit = name_and_unit(cell)[1]
                self.columns["rpm1"] = ColumnSource(column=cell, unit=unit)
            return
        speeds = {name: source for name, source in guess.items() if _SPEED.fullmatch(name)}
        measured = {name: one for name, one in speeds.items() if name.startswith("rpm")}
        if measured or speeds:
            self.columns |= measured or speeds
            return
        self.columns["rpm1"] = ColumnSource(constant=ONE_RPM, unit="rpm")
        if "thrust_N" in self.columns:
            self.notes.append(
                f"no column is a rotor speed: every row counts as one speed, {ONE_RPM:g} rpm, and "
                f"k is the thrust without a plate over that speed squared (--rpm says the speed)"
            )

    def _error(self) -> None:
        of_what = "thrust_N" if "thrust_N" in self.columns else "thrust_ratio"
        own = self.columns[of_what].column or ""
        given = self.given
        cell = "" if given.error in ("", NONE) else self.column(given.error, "--error")
        if not given.error:
            stem = name_and_unit(own)[0].casefold()
            beside = [one for one in self.header if _error_of(one, stem)]
            cell = beside[0] if len(beside) == 1 else ""
        if not cell:
            return
        kind = given.error_is or ask(
            f"{cell}: scatter of single readings (sd), or standard error of their mean (se)",
            "--error-is sd or --error-is se (or --error none)",
            choices=("sd", "se"),
            reason=f"{self.table.where}: column {cell!r} may hold the scatter of single readings "
            f"or the standard error of their mean",
        )
        unit = name_and_unit(cell)[1] or name_and_unit(own)[1] or self.columns[of_what].unit
        name = {"thrust_N": f"thrust_{kind}_N", "thrust_ratio": f"thrust_ratio_{kind}"}[of_what]
        self.columns[name] = ColumnSource(
            column=cell, unit=unit if of_what == "thrust_N" and unit != "N" else None
        )

    def _runs(self) -> tuple[str, tuple[str, ...]]:
        """Return the column that names runs, and the runs to fit one by one."""
        given, used = self.given.runs, {source.column for source in self.columns.values()}
        if given == NONE:
            return "", ()
        if given:
            cell = self.column(given, "--runs")
            return cell, tuple(dict.fromkeys(self._texts(cell)))
        naming = {cell: self._names_in(cell) for cell in self.header if cell not in used}
        cell = max(naming, key=lambda one: len(naming[one]), default="")
        if len(names := naming.get(cell, ())) < 2:
            return "", ()
        listed = ", ".join(names[:6]) + (", ..." if len(names) > 6 else "")
        answer = ask(
            f"Column {cell} names {len(names)} runs ({listed}): fit which one, each, or all as one",
            f"--where {cell}={names[0]} for one, --runs {cell} for each by itself, or --runs none",
            usual="each",
            choices=("each", "all", *names),
            reason=f"{self.table.where}: column {cell!r} names {len(names)} runs ({listed})",
        )
        if answer == "all":
            return "", ()
        return cell, names if answer == "each" else (answer,)

    def _names_in(self, cell: str) -> tuple[str, ...]:
        """Return the names of runs that a column may hold: words, each in several rows."""
        texts = self._texts(cell)
        names = tuple(dict.fromkeys(texts))
        words = all(text and not _is_number(text) for text in names)
        return names if words and 2 * len(names) <= len(texts) else ()

    def _texts(self, cell: str) -> list[str]:
        position = self.table.header.index(cell)
        return [row[position].strip() for row in self.table.rows]

    def _numbers(self, cell: str) -> Any:
        values = (float(text) for text in self._texts(cell) if _is_number(text))
        return np.array([value for value in values if np.isfinite(value)])


FAR = ("inf", "infinity", "∞", "far", "oge", "ref", "reference", "park", "parked")
"""Words among distances that say that there was no plate near."""

FARTHEST = 30.0
"""Rotor radii; a nearest plate beyond is a wrong unit."""

ONE_RPM = 6000.0
"""Stands in for a speed that nobody measured."""

_SPEED = re.compile(r"rpm\d+|pwm\d+_us")
_ERROR = re.compile(
    r"(?P<stem>.*?)[\s_]*(?:std|stdev|stddev|sd|se|sem|err|error|sigma|fehler|stabw|standardabweichung|streuung)"
)


def _error_of(cell: str, stem: str) -> bool:
    """Return whether a column's name is that of another's error."""
    found = _ERROR.fullmatch(name_and_unit(cell)[0].casefold())
    return found is not None and found["stem"] in (stem, "")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return text in ("", "nan", "NaN", "NA", "N/A", "null")
    return text.casefold() not in FAR


def first_values(values: Any) -> str:
    """Return the first numbers of a column, for people."""
    some = [f"{value:.4g}" for value in values[:3]]
    return ", ".join(some) + (", ..." if len(values) > 3 else "")
