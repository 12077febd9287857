"""Column map, rig and model of a CSV table for a fit, from header and options."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from math import isfinite, isnan, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchtool.core.channel import ColumnSource
from benchtool.core.errors import FileFormatError, InputError, UnknownChoice
from benchtool.core.inputs import with_changes
from benchtool.core.rig_file import load_rig_by_name, parse_rig
from benchtool.core.user_file import list_names
from benchtool.data.atomic import write_if_new
from benchtool.data.column_map import (
    RADII_PER_UNIT,
    Conversion,
    column_map_to_text,
    column_map_to_toml,
    find_conversion,
    guess_columns,
    is_similar,
    name_and_unit,
    unit_in_header,
)
from benchtool.data.columns import speed_columns
from benchtool.data.csv_text import BLANK_CELLS, read_csv_header, read_csv_text
from benchtool.data.formats.formats import is_stand_table
from benchtool.data.run.read import load_rig_for_data
from benchtool.data.table import RowFilter, filter_rows, parse_column, read_table
from benchtool.data.table_rig import build_radius_rig
from benchtool.fit.recipe import TableInputs

if TYPE_CHECKING:
    from benchtool.core.rig import Rig

MODEL = "single"  # one rotor over a plate
NONE = "none"
OGE_WORDS = ("inf", "infinity", "∞", "far", "oge", "ref", "reference", "park", "parked")
MAX_NEAREST_OVER_R = 30.0  # a larger minimum distance is a unit error; assumed
MIN_NEAREST_IN_MM_OVER_R = 200.0  # a larger number is in mm, a smaller one in cm; assumed
DEFAULT_RADIUS_M = 0.1  # to detect a unit error without a radius; assumed
DEFAULT_RPM = 6000.0  # for an unknown speed; assumed
_ERROR = re.compile(
    r"(?P<stem>.*?)[\s_]*(?P<ending>std|stdev|stddev|sd|se|sem|err|error|sigma|fehler|stabw|standardabweichung|streuung)"
)


def prepare_table(
    options: dict[str, Any],
    table: TableInputs,
    inform: Callable[[str], object],
    note: Callable[[str], object],
    *,
    command: str = "",
    folder: Path = Path(),
) -> tuple[str, ...]:
    """Add column map, rig, model and basis of a table to the options of a fit.

    Return row filters COLUMN=VALUE, one for each run of the table to fit separately. No-op for
    runs, and for tables with a column map, a model file that describes the columns, or our own
    names and a known rig. The error for missing items ends with the completed command.

    Args:
        inform, note: called with each message about written files, and about assumptions.
        command: the typed command; empty for a call from Python.
    """
    data = options["data"]
    if not all(Path(path).is_file() for path in data):
        if with_changes(table):
            raise InputError("table options are given, but the data are not a table; remove them")
        return ()
    first = str(data[0])
    is_stand = is_stand_table(first) and not with_changes(table) - {"radius": 0}.keys()
    options.setdefault("model", MODEL)
    user_model = "" if options["model"] in list_names("models") else str(options["model"])
    user_rig, describes_columns = None, False
    if user_model:
        from benchtool.physics.model_file import read_model_head  # imports all effects

        user_rig, describes_columns = read_model_head(user_model)
    has_map = is_stand or options.get("columns") is not None
    if not (with_changes(table) or is_stand) and (
        has_map
        or describes_columns
        or ((user_model or options.get("rig") or load_rig_for_data([first])) and _is_own(first))
    ):
        return ()  # the columns are described
    radius_m, rig_text = _radius(options.get("rig"), table, first, is_stand, user_rig)
    if has_map and not is_stand and with_changes(table).keys() - {"radius", "runs"}:
        raise InputError("--map contains all columns; remove the other column options")
    where = tuple(options.get("where", ()))
    columns = _Columns(first, table, radius_m, command)
    if not has_map:
        columns.choose(where)
    columns.require_all()
    run_filters = tuple(f"{columns.run_column}={name}" for name in columns.runs)
    recording = None if has_map else read_table(first, columns.map, (*where, *run_filters[:1]))

    def write(kind: str, text: str) -> str:
        path, is_new = write_if_new(folder / f"{Path(first).stem}.{kind}.toml", text)
        if is_new:
            inform(f"written: {path}")
        return str(path)

    if rig_text:
        options["rig"] = write("rig", rig_text)
    if recording is None:
        return ()
    text = column_map_to_toml(columns.map)
    options["columns"] = write("columns", text)
    if "thrust_ratio" in columns.map:
        options["basis"] = options.get("basis") or "equal_rpm2"
    if any(name.endswith(("_sd", "_sd_N")) for name in columns.map):
        options.setdefault("noise", "scale")
    if options.get("verbose"):
        inform(f"{first}: {len(recording)} rows, read with this column map:\n{text.rstrip()}")
    else:
        inform(f"{first}: {len(recording)} rows; {column_map_to_text(columns.map)}")
    for line in filter(None, (*columns.notes, *recording.provenance["repairs"].split("; "))):
        note(line)
    arguments = ["benchtool", "fit", *map(str, options["data"]), "--map", options["columns"]]
    for option in ("rig", "model", "basis", "noise"):
        arguments += [f"--{option}", str(options[option])] if options.get(option) else []
    inform(f"repeat with: {shlex.join(arguments)}")
    return run_filters


def _is_own(path: str) -> bool:
    """Return whether a table has benchtool's own column names for thrust and speed."""
    header = read_csv_header(Path(path))
    return "thrust_ratio" in header or ("thrust_N" in header and bool(speed_columns(header)))


def _radius(
    rig: str | None, table: TableInputs, first: str, is_stand: bool, user_rig: Rig | None
) -> tuple[float, str]:
    """Return the rotor radius, nan if unknown, and the text of a new rig file, or ""."""
    if rig is not None:
        if table.radius is not None:
            raise InputError("--radius and --rig are both given; give one of them")
        return load_rig_by_name(rig).propulsion.radius_m, ""
    if table.radius is None and (known_rig := load_rig_for_data([first]) or user_rig):
        return known_rig.propulsion.radius_m, ""
    text = build_radius_rig(first, table.radius, is_stand=is_stand)
    return (parse_rig(text, f"rig of {first}").propulsion.radius_m if text else nan), text


class _Columns:
    """Column map of one table, its runs, notes, and missing items with their options."""

    def __init__(self, path: str, options: TableInputs, radius_m: float, command: str) -> None:
        self.path, self.options, self.radius_m, self.command = path, options, radius_m, command
        self.map: dict[str, ColumnSource] = {}
        self.runs: tuple[str, ...] = ()
        self.run_column, self.notes = "", list[str]()
        self.problems, self.completion = list[str](), list[str]()
        if isnan(radius_m):
            hint = "--radius RADIUS, as 0.1016 or 4in, or --rig FILE"
            self._add_missing("the rotor radius is missing", hint, "--radius RADIUS")

    def choose(self, where: Sequence[str]) -> None:
        table = read_csv_text(Path(self.path))
        self.table = filter_rows(table, [RowFilter.parse(text) for text in where])
        self.header = [cell for cell in table.header if cell]
        guess = guess_columns(self.header, radius_m=self.radius_m)
        self._choose_thrust(guess)
        self._choose_distance(guess)
        self._choose_reference()
        self._choose_speed(guess)
        self._choose_error()
        extra = ("time_s", "voltage_V", "current_A", "torque_Nm", "power_W")
        self.map |= {name: guess[name] for name in extra if name in guess}
        self._choose_runs()
        for name, source in self.map.items():
            if name not in ("plate_z_m", "kind") and source.column in self.header:
                self._check_numbers(source.column)

    def require_all(self) -> None:
        """Raise InputError if anything is missing, with the completed command."""
        if not self.problems:
            return
        lines = [f"{self.path}: {problem}" for problem in self.problems]
        if self.completion and self.command:
            lines += [f"complete the command: {' '.join([self.command, *self.completion])}"]
        raise InputError("\n".join(lines))

    def _add_missing(self, problem: str, hint: str, option: str = "") -> None:
        """Add a problem with its options; the first, or `option`, completes the command."""
        self.problems.append(f"{problem}; add {hint}")
        self.completion.append(option or hint.partition(" or ")[0])

    def _column(
        self, channel: str, name: str, options: str, title: str, guess: Mapping[str, ColumnSource]
    ) -> str:
        """Return the column from an option or the header, or ""."""
        if name:
            return self._find(name, options.split()[0])
        if channel in guess:
            return guess[channel].column or ""
        problem = f"no column name matches {title} (columns: {', '.join(self.header)})"
        used = {source.column for source in (*guess.values(), *self.map.values())}
        unused = [cell for cell in self.header if cell not in used and self._has_numbers(cell)]
        similar = [cell for cell in unused if is_similar(cell, channel)]
        default = NONE if channel == "plate_z_m" and not unused else ""
        guessed = next((cells[0] for cells in (similar, unused) if len(cells) == 1), default)
        option = shlex.join([options.split()[0], guessed]) if guessed else ""
        self._add_missing(problem, options, option)
        self.map[channel] = ColumnSource(column=guessed or "COLUMN")
        return ""

    def _find(self, name: str, option: str) -> str:
        """Return the column of an option value, with or without unit, in any case."""
        if name in self.header:
            return name
        matches = [cell for cell in self.header if name_and_unit(cell)[0].lower() == name.lower()]
        if len(matches) != 1:
            raise UnknownChoice(f"column for {option} in {self.table.where}", name, self.header)
        return matches[0]

    def _unit(self, cell: str, unit: str, option: str, default: str) -> str | None:
        """Return the unit to write for a column; None, with a note, for the default unit."""
        if unit:
            self._compare(cell, find_conversion(unit, default), unit, option, default)
            return unit
        if (name_unit := name_and_unit(cell)[1]) is None:
            self.notes.append(f"{cell!r} has no unit; {default} is assumed, {option} changes it")
        return name_unit

    def _compare(self, cell: str, used: Conversion | None, unit: str, name: str, si: str) -> None:
        """Add a note if the unit in a column's name converts otherwise than the option's."""
        note = f"{name} {unit} contradicts the unit in {cell!r}; {unit} is used"
        try:
            is_same = unit_in_header((unit and name_and_unit(cell)[1]) or "", si) in (None, used)
        except InputError:  # another dimension
            is_same = False
        self.notes += [] if is_same else [note]

    def _choose_thrust(self, guess: Mapping[str, ColumnSource]) -> None:
        options = self.options
        if options.ratio and options.thrust:
            raise InputError("--thrust and --ratio are both given; give one of them")
        if options.ratio:
            self.map["thrust_ratio"] = ColumnSource(column=self._find(options.ratio, "--ratio"))
        elif not options.thrust and "thrust_N" not in guess and "thrust_ratio" in guess:
            self.map["thrust_ratio"] = guess["thrust_ratio"]
        elif cell := self._column(
            "thrust_N", options.thrust, "--thrust COLUMN or --ratio COLUMN", "the thrust", guess
        ):
            unit = self._unit(cell, options.unit, "--unit", "N")
            self.map["thrust_N"] = ColumnSource(column=cell, unit=unit)

    def _choose_distance(self, guess: Mapping[str, ColumnSource]) -> None:
        options, hint = self.options, "--z COLUMN or --z none without a plate"
        if options.z == NONE or not (
            cell := self._column("plate_z_m", options.z, hint, "the plate distance", guess)
        ):
            return
        radii = {"R": 1.0, "D": 2.0}.get(options.z_unit.upper())
        if not options.z_unit:
            radii = RADII_PER_UNIT.get(name_and_unit(cell)[0].lower())
        if radii is not None:
            self._compare(cell, None, options.z_unit, "--z-unit", "m")
            self.map["plate_z_m"] = ColumnSource(column=cell, factor=radii * self.radius_m)
            return
        unit = self._unit(cell, options.z_unit, "--z-unit", "m")
        self.map["plate_z_m"] = ColumnSource(column=cell, unit=unit)
        numbers = [value for text in self._texts(cell) if (value := _number(text)) is not None]
        radius_m = DEFAULT_RADIUS_M if isnan(self.radius_m) else self.radius_m
        nearest = min(filter(isfinite, numbers), default=nan) / radius_m
        if unit is None and nearest > MAX_NEAREST_OVER_R:
            self._add_missing(
                f"minimum distance in {cell!r}, read in m, is {nearest:.3g} rotor radii, out of "
                "ground effect; its unit is missing (mm, cm, in, R for rotor radii)",
                "--z-unit UNIT",
                f"--z-unit {'mm' if nearest > MIN_NEAREST_IN_MM_OVER_R else 'cm'}",
            )

    def _choose_reference(self) -> None:
        source = self.map.get("plate_z_m")
        if self.options.reference:
            row_filter = RowFilter.parse(self.options.reference)
            cell, value = self._find(row_filter.column, "--reference"), row_filter.value
            filter_rows(self.table, [RowFilter(cell, value)])
            self.map["kind"] = ColumnSource(column=cell, reference=value)
        elif source is not None and source.column in self.header:
            cell = source.column
            texts = sorted({text for text in self._texts(cell) if _number(text) is None})
            if len(texts) == 1 and texts[0].casefold() in OGE_WORDS:
                self.map["kind"] = ColumnSource(column=cell, reference=texts[0])
            elif texts:
                self._add_missing(
                    f"column {cell!r} contains {texts[0]!r} among its distances; correct it, or "
                    "select the rows out of ground effect",
                    shlex.join(["--reference", f"{cell}={texts[0]}"]),
                )

    def _choose_speed(self, guess: Mapping[str, ColumnSource]) -> None:
        if self.options.rpm and self.options.rpm != NONE:
            try:
                self.map["rpm1"] = ColumnSource(constant=float(self.options.rpm), unit="rpm")
            except ValueError:
                cell = self._find(self.options.rpm, "--rpm")
                self.map["rpm1"] = ColumnSource(column=cell, unit=name_and_unit(cell)[1])
            return
        if names := speed_columns(guess, "rpm") or speed_columns(guess):
            self.map |= {name: guess[name] for name in names}
            return
        self.map["rpm1"] = ColumnSource(constant=DEFAULT_RPM, unit="rpm")
        if "thrust_N" in self.map:
            self.notes.append(
                f"no rotor speed column: {DEFAULT_RPM:g} rpm is assumed for all rows, and k is the "
                f"thrust without a plate over this speed squared (--rpm sets the speed)"
            )

    def _choose_error(self) -> None:
        channel = "thrust_ratio" if "thrust_ratio" in self.map else "thrust_N"
        observed, options = self.map[channel], self.options
        column = observed.column or ""
        cell = "" if options.error in ("", NONE) else self._find(options.error, "--error")
        if not options.error:
            stem = name_and_unit(column)[0].casefold()
            matches = [(name, _match_error(name)) for name in self.header]
            errors = [name for name, match in matches if match and match["stem"] in ("", stem)]
            cell = errors[0] if len(errors) == 1 else ""
        if not cell:
            return
        unit = name_and_unit(cell)[1] or name_and_unit(column)[1] or observed.unit
        source = ColumnSource(
            column=cell, unit=unit if channel == "thrust_N" and unit != "N" else None
        )
        name = {"thrust_N": "thrust_{}_N", "thrust_ratio": "thrust_ratio_{}"}[channel]
        self.map[name.format(options.error_is or "SD_OR_SE")] = source
        if options.error_is is None:
            ending = match["ending"] if (match := _match_error(cell)) else "error"
            kind = "se" if ending in ("se", "sem") else "" if ending[:3] in ("err", "feh") else "sd"
            self._add_missing(
                f"column {cell!r} may be the standard deviation of readings (sd) or the standard "
                "error of the mean (se)",
                "--error-is SD_OR_SE or --error none",
                f"--error-is {kind}" if kind else "",
            )

    def _choose_runs(self) -> None:
        """Set the column of run names, and the runs to fit separately."""
        option, used = self.options.runs, {source.column for source in self.map.values()}
        if option == NONE:
            return
        if option:
            self.run_column = self._find(option, "--runs")
            self.runs = tuple(dict.fromkeys(self._texts(self.run_column)))
            return
        candidates = {cell: self._run_names(cell) for cell in self.header if cell not in used}
        cell = max(candidates, key=lambda name: len(candidates[name]), default="")
        if len(names := candidates.get(cell, ())) < 2:
            return
        first_names = ", ".join(names[:6]) + (", ..." if len(names) > 6 else "")
        one = shlex.join(["--where", f"{cell}={names[0]}"])
        separate = f"{shlex.join(['--runs', cell])} or " if self.command else ""  # one fit a call
        self._add_missing(
            f"column {cell!r} contains {len(names)} run names ({first_names})",
            f"{separate}--runs none for one fit of all, or {one} for one",
        )

    def _run_names(self, cell: str) -> tuple[str, ...]:
        """Return the run names in a column of repeated words, or nothing."""
        names = tuple(dict.fromkeys(texts := self._texts(cell)))
        return names if {*map(_number, names)} == {None} and 2 * len(names) <= len(texts) else ()

    def _has_numbers(self, cell: str) -> bool:
        """Return whether a column has numbers that vary."""
        numbers = {value for text in self._texts(cell) if (value := _number(text)) is not None}
        return len(numbers) > 1 and _match_error(cell) is None

    def _check_numbers(self, cell: str) -> None:
        """Add the first cell of a column that is not a number."""
        try:
            parse_column(self.table, self.table.header.index(cell))
        except FileFormatError as error:
            self.problems.append(str(error).removeprefix(f"{self.path}, "))

    def _texts(self, cell: str) -> list[str]:
        return list(self.table.rows[:, self.table.header.index(cell)])


def _match_error(cell: str) -> re.Match[str] | None:
    return _ERROR.fullmatch(name_and_unit(cell)[0].casefold())


def _number(text: str) -> float | None:
    """Return the number in a cell, nan for an empty cell, None for a word."""
    if text in BLANK_CELLS:
        return nan
    try:
        return None if text.casefold() in OGE_WORDS else float(text)
    except ValueError:
        return None
