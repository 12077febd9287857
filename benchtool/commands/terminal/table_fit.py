"""Columns, rig and model of a table for `benchtool fit`, from its headers and options."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import count
from math import isfinite, isnan, nan
from pathlib import Path
from typing import Any

import tomli_w

from benchtool.commands.recipe_options import TableInputs
from benchtool.core.column_source import ColumnSource
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.inputs import build_inputs, items, with_changes
from benchtool.core.rig_file import load_rig_by_name, parse_rig
from benchtool.data.column_map import (
    IN_RADII,
    column_map_to_toml,
    guess_columns,
    name_and_unit,
)
from benchtool.data.csv_text import read_csv_header, read_csv_text
from benchtool.data.formats.formats import import_file, is_stand_table
from benchtool.data.repairs.foreign_units import conversion
from benchtool.data.run.read import is_run
from benchtool.data.run.run_rig import load_rig_for_data
from benchtool.data.table import RowFilter, read_table, rows_where
from benchtool.physics.model_file import model_names, stated_in

MODEL = "single"  # model of a table where none is named: one rotor over a plate
NONE = "none"
FAR = ("inf", "infinity", "∞", "far", "oge", "ref", "reference", "park", "parked")
MAX_NEAREST_OVER_R = 30.0  # a nearest plate beyond is a wrong unit; assumed
ONE_RPM = 6000.0  # in place of an unknown speed; assumed
_SPEED = re.compile(r"rpm\d+|pwm\d+_us")
_ERROR = re.compile(
    r"(?P<stem>.*?)[\s_]*(?:std|stdev|stddev|sd|se|sem|err|error|sigma|fehler|stabw|standardabweichung|streuung)"
)
DRAFT = ColumnSource(column="COLUMN", unit="UNIT")  # an entry that a user completes


def prepare_table(given: dict[str, Any]) -> tuple[str, ...]:
    """Complete the inputs of `benchtool fit` for a table: its map, rig, model and basis.

    Nothing is done where a run is fitted, or where a map or a model file says what columns are.

    Args:
        given: inputs by name, changed in place.

    Returns:
        Filters COLUMN=VALUE of runs in the table that are to be fitted one by one.

    Raises:
        InputError: lists all that is missing, the command to complete, and the map so far.
    """
    names = {item.name for item in items(TableInputs)}
    table = build_inputs(
        TableInputs, {name: given[name] for name in names & given.keys()}, source="option"
    )
    paths = [path for path in given.get("data", ()) if Path(path).is_file()]
    if not all(Path(path).exists() for path in given.get("data", ())):
        return ()  # reading them says which one is missing
    if not paths or len(paths) < len(given["data"]) or any(map(is_run, paths)):
        if with_changes(table):
            raise InputError(
                "columns of a table are named, but the data are no table; leave them out"
            )
        return ()
    first = str(paths[0])
    known = is_stand_table(first) and not with_changes(table) - {"radius": 0}.keys()
    given.setdefault("model", MODEL)
    own_model = "" if given["model"] in model_names() else str(given["model"])
    has_map = known or given.get("columns") is not None
    if not (with_changes(table) or known) and (
        has_map
        or (own_model and stated_in(own_model)[1])
        or {"thrust_N", "thrust_ratio"} & set(read_csv_header(Path(first)))
    ):
        return ()  # the columns are described
    radius_m, rig_text = _radius(given.get("rig"), table, first, known, own_model)
    if has_map and not known and with_changes(table).keys() - {"radius", "runs"}:
        raise InputError("--map says which column is which; leave the other columns out")
    where = tuple(given.get("where", ()))
    columns = _Columns(first, table, radius_m)
    if not has_map:
        columns.choose(where)
    columns.require_all()
    if rig_text:
        given["rig"] = str(_written(f"{Path(first).stem}.rig", rig_text))
    if has_map:
        return ()
    one = tuple(f"{columns.run_column}={name}" for name in columns.runs)
    recording = read_table(first, columns.map, (*where, *one[:1]))
    text = column_map_to_toml(columns.map)
    given["columns"] = str(_written(f"{Path(first).stem}.columns", text))
    if "thrust_ratio" in columns.map:
        given["basis"] = given.get("basis") or "equal_rpm2"
    if any(name.endswith(("_sd", "_sd_N")) for name in columns.map):
        given.setdefault("noise", "scale")
    repairs = filter(None, recording.provenance["repairs"].split("; "))
    print(f"{first}: {len(recording)} rows, read by this map:\n{text}", end="")
    for note in (*columns.notes, *repairs):
        print(f"note: {note}")
    words = ["benchtool", "fit", *map(str, given["data"]), "--map", given["columns"]]
    for option in ("rig", "model", "basis", "noise"):
        words += [f"--{option}", str(given[option])] if given.get(option) else []
    print(f"again: {shlex.join(words)}")
    return one


def _radius(
    rig: str | None, table: TableInputs, first: str, known: bool, own_model: str
) -> tuple[float, str]:
    """Return the rotor radius, nan if unknown, and the text of a new rig file if it needs one."""
    if rig is not None:
        if table.radius is not None:
            raise InputError("--radius and --rig are both given; give one of them")
        return load_rig_by_name(rig).propulsion.radius_m, ""
    if table.radius is None and (own := load_rig_for_data([first])) is not None:
        return own.propulsion.radius_m, ""
    if table.radius is None and own_model:
        return stated_in(own_model)[0].propulsion.radius_m, ""
    text = radius_rig(first, table.radius, known=known)
    return (parse_rig(text, f"rig of {first}").propulsion.radius_m if text else nan), text


def radius_rig(first: str, radius_m: float | None, *, known: bool) -> str:
    """Return the rig file's text of a table whose rotor radius alone is known.

    Args:
        radius_m: None takes the diameter that a stand's table states; empty where it states none.
        known: the table is a stand's, which also says how many rotors there are.
    """
    source, rotors = "given as the rotor radius of a table", 1
    if known:
        recording = import_file(first).recording
        rotors = max(
            1, sum(name.startswith("rpm") and name[3:].isdigit() for name in recording.names)
        )
        if radius_m is None and "diameter_m" in recording.provenance:
            radius_m = 0.5 * float(recording.provenance["diameter_m"])
            source = "the file's own diameter"
    if radius_m is None:
        return ""
    data: dict[str, Any] = {"name": Path(first).stem}
    if rotors > 1:
        # Without a plate the places enter nothing; with one, a rig has to say them.
        place = {"x_m": 0.0, "y_m": 0.0}
        source_of = {"source": "not known, and without a plate of no effect"}
        data["rotors"] = [
            {"name": f"rotor {i + 1}", "spin": {"value": 1 - 2 * (i % 2)} | source_of}
            | {key: {"value": value} | source_of for key, value in place.items()}
            for i in range(rotors)
        ]
    data["propulsion"] = {"source": source, "radius_m": radius_m}
    return tomli_w.dumps(data)


def _written(stem: str, text: str) -> Path:
    """Return a file of this text in the present folder: one that is there, or a new one."""
    for number in count(1):
        path = Path(f"{stem}.toml" if number == 1 else f"{stem}-{number}.toml")
        if not path.exists():
            path.write_text(text, encoding="utf-8")
            print(f"written: {path}")
            break
        if path.read_text(encoding="utf-8", errors="replace") == text:
            break
    return path


class _Columns:
    """Column map of one table, its runs, notes, and what is missing, with the option for it."""

    def __init__(self, path: str, given: TableInputs, radius_m: float) -> None:
        self.path, self.given, self.radius_m = path, given, radius_m
        self.map: dict[str, ColumnSource] = {}
        self.runs: tuple[str, ...] = ()
        self.run_column, self.notes, self.missing = "", list[str](), list[tuple[str, str]]()
        if isnan(radius_m):
            self._lacks("the rotor's size is not stated", "--radius RADIUS_M or --rig FILE")

    def choose(self, where: Sequence[str]) -> None:
        whole = read_csv_text(Path(self.path))
        rows = rows_where(whole, [RowFilter.parse(text) for text in where])
        self.table = replace(whole, rows=[whole.rows[row] for row in rows])
        self.header = [cell for cell in whole.header if cell]
        guess = guess_columns(self.header, radius_m=self.radius_m)
        self._choose_thrust(guess)
        self._choose_distance(guess)
        self._choose_reference()
        self._choose_speed(guess)
        self._choose_error()
        for name in ("time_s", "voltage_V", "current_A", "torque_Nm", "power_W"):
            if name in guess:
                self.map.setdefault(name, guess[name])
        self._choose_runs()

    def require_all(self) -> None:
        """Raise InputError if anything is missing, with the command to complete and the map."""
        if not self.missing:
            return
        options = [option.partition(" or ")[0] for _, option in self.missing]
        command = " ".join([shlex.join(["benchtool", *sys.argv[1:]]), *options])
        lines = [f"{self.path}: {what}; give {option}" for what, option in self.missing]
        lines += [f"complete the command: {command}"]
        if self.map:
            text = column_map_to_toml(self.map).replace("= nan", "= ROTOR_RADIUS_OR_DIAMETER_M")
            lines += ["or a map for --map FILE:", text.rstrip()]
        raise InputError("\n".join(lines))

    def _lacks(self, what: str, option: str) -> None:
        self.missing.append((what, option))

    def _column(
        self, channel: str, given: str, options: str, what: str, guess: Mapping[str, ColumnSource]
    ) -> str:
        """Return the column that an option or the header names; empty if neither does."""
        if given:
            return self._find(given, options.split()[0])
        if channel in guess:
            return guess[channel].column or ""
        listed = ", ".join(self.header)
        self._lacks(f"no column's name says which is {what} (columns: {listed})", options)
        self.map[channel] = DRAFT
        return ""

    def _find(self, name: str, option: str) -> str:
        """Return the column that an option names, with or without its unit, in any case."""
        if name in self.header:
            return name
        folded = name.casefold()
        alike = [cell for cell in self.header if name_and_unit(cell)[0].casefold() == folded]
        if len(alike) != 1:
            raise UnknownChoice(f"column for {option} in {self.table.where}", name, self.header)
        return alike[0]

    def _unit(self, cell: str, stated: str, option: str, own: str) -> str | None:
        """Return the unit to write for a column; None, with a note, where it is ours by default."""
        if stated:
            conversion(stated, own)
            return stated
        if (in_name := name_and_unit(cell)[1]) is None:
            self.notes.append(
                f"{cell!r} names no unit and is read in {own} ({option} says another)"
            )
        return in_name

    def _choose_thrust(self, guess: Mapping[str, ColumnSource]) -> None:
        given = self.given
        if given.ratio and given.thrust:
            raise InputError("--thrust and --ratio are both given; give one of them")
        if given.ratio:
            self.map["thrust_ratio"] = ColumnSource(column=self._find(given.ratio, "--ratio"))
        elif not given.thrust and "thrust_N" not in guess and "thrust_ratio" in guess:
            self.map["thrust_ratio"] = guess["thrust_ratio"]
        elif cell := self._column(
            "thrust_N", given.thrust, "--thrust COLUMN or --ratio COLUMN", "the thrust", guess
        ):
            unit = self._unit(cell, given.unit, "--unit", "N")
            self.map["thrust_N"] = ColumnSource(column=cell, unit=unit)

    def _choose_distance(self, guess: Mapping[str, ColumnSource]) -> None:
        given, options = self.given, "--z COLUMN or --z none without a plate"
        if given.z == NONE or not (
            cell := self._column("plate_z_m", given.z, options, "the plate's distance", guess)
        ):
            return
        radii = {"R": 1.0, "D": 2.0}.get(given.z_unit.upper())
        if not given.z_unit:
            radii = IN_RADII.get(name_and_unit(cell)[0].lower())
        if radii is not None:
            self.map["plate_z_m"] = ColumnSource(column=cell, factor=radii * self.radius_m)
            return
        in_file = self._unit(cell, given.z_unit, "--z-unit", "m")
        self.map["plate_z_m"] = ColumnSource(column=cell, unit=in_file)
        numbers = [value for text in self._texts(cell) if (value := _number(text)) is not None]
        nearest = min(filter(isfinite, numbers), default=nan) / self.radius_m
        if in_file is None and nearest > MAX_NEAREST_OVER_R:
            self._lacks(
                f"the nearest distance in {cell!r}, read in m, is {nearest:.3g} rotor radii, where "
                "there is no ground effect; its unit is missing (mm, cm, in, R for rotor radii)",
                "--z-unit UNIT",
            )

    def _choose_reference(self) -> None:
        source = self.map.get("plate_z_m")
        if self.given.reference:
            named = RowFilter.parse(self.given.reference)
            cell, value = self._find(named.column, "--reference"), named.value
            if not rows_where(self.table, [RowFilter(cell, value)]):
                raise InputError(f"no row has {cell}={value}; correct --reference")
            self.map["kind"] = ColumnSource(column=cell, reference=value)
        elif source is not None and source is not DRAFT:
            cell = source.column or ""
            words = sorted({text for text in self._texts(cell) if _number(text) is None})
            if len(words) == 1 and words[0].casefold() in FAR:
                self.map["kind"] = ColumnSource(column=cell, reference=words[0])
            elif words:
                self._lacks(
                    f"column {cell!r} holds {words[0]!r} among its distances; correct it, or name "
                    "the rows far from the plate",
                    "--reference COLUMN=VALUE",
                )

    def _choose_speed(self, guess: Mapping[str, ColumnSource]) -> None:
        if self.given.rpm and self.given.rpm != NONE:
            try:
                self.map["rpm1"] = ColumnSource(constant=float(self.given.rpm), unit="rpm")
            except ValueError:
                cell = self._find(self.given.rpm, "--rpm")
                self.map["rpm1"] = ColumnSource(column=cell, unit=name_and_unit(cell)[1])
            return
        speeds = {name: source for name, source in guess.items() if _SPEED.fullmatch(name)}
        measured = {name: source for name, source in speeds.items() if name.startswith("rpm")}
        if measured or speeds:
            self.map |= measured or speeds
            return
        self.map["rpm1"] = ColumnSource(constant=ONE_RPM, unit="rpm")
        if "thrust_N" in self.map:
            self.notes.append(
                f"no column is a rotor speed: every row counts as one speed, {ONE_RPM:g} rpm, and "
                f"k is the thrust without a plate over that speed squared (--rpm says the speed)"
            )

    def _choose_error(self) -> None:
        of_what = "thrust_ratio" if "thrust_ratio" in self.map else "thrust_N"
        observed, given = self.map[of_what], self.given
        own = observed.column or ""
        cell = "" if given.error in ("", NONE) else self._find(given.error, "--error")
        if not given.error:
            stem = name_and_unit(own)[0].casefold()
            errors = [name for name in self.header if _is_error_of(name, stem)]
            cell = errors[0] if len(errors) == 1 else ""
        if not cell:
            return
        unit = name_and_unit(cell)[1] or name_and_unit(own)[1] or observed.unit
        source = ColumnSource(
            column=cell, unit=unit if of_what == "thrust_N" and unit != "N" else None
        )
        name = {"thrust_N": "thrust_{}_N", "thrust_ratio": "thrust_ratio_{}"}[of_what]
        self.map[name.format(given.error_is or "SD_OR_SE")] = source
        if given.error_is is None:
            self._lacks(
                f"column {cell!r} may hold the scatter of single readings (sd) or the standard "
                "error of their mean (se)",
                "--error-is SD_OR_SE or --error none",
            )

    def _choose_runs(self) -> None:
        """Set the column that names runs, and the runs to fit one by one."""
        given, used = self.given.runs, {source.column for source in self.map.values()}
        if given == NONE:
            return
        if given:
            self.run_column = self._find(given, "--runs")
            self.runs = tuple(dict.fromkeys(self._texts(self.run_column)))
            return
        naming = {cell: self._run_names(cell) for cell in self.header if cell not in used}
        cell = max(naming, key=lambda name: len(naming[name]), default="")
        if len(names := naming.get(cell, ())) < 2:
            return
        listed = ", ".join(names[:6]) + (", ..." if len(names) > 6 else "")
        self._lacks(
            f"column {cell!r} names {len(names)} runs ({listed})",
            f"{shlex.join(['--runs', cell])} or --runs none for all as one, or "
            f"{shlex.join(['--where', f'{cell}={names[0]}'])} for one",
        )

    def _run_names(self, cell: str) -> tuple[str, ...]:
        """Return the names of runs that a column may hold: words, each in several rows."""
        texts = self._texts(cell)
        names = tuple(dict.fromkeys(texts))
        words = all(_number(text) is None for text in names)
        return names if words and 2 * len(names) <= len(texts) else ()

    def _texts(self, cell: str) -> list[str]:
        position = self.table.header.index(cell)
        return [row[position].strip() for row in self.table.rows]


def _is_error_of(cell: str, stem: str) -> bool:
    found = _ERROR.fullmatch(name_and_unit(cell)[0].casefold())
    return found is not None and found["stem"] in (stem, "")


def _number(text: str) -> float | None:
    """Return the number in a cell, nan for an empty one, None for a word."""
    if text in ("", "nan", "NaN", "NA", "N/A", "null"):
        return nan
    try:
        return None if text.casefold() in FAR else float(text)
    except ValueError:
        return None
