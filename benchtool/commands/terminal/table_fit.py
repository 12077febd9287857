"""Make a table ready for a fit: its columns, its rig, and the files that state both."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from benchtool.commands.recipe_options import TableInputs
from benchtool.commands.terminal.column_choice import (
    ColumnChoice,
    choose_columns,
    first_values,
)
from benchtool.commands.terminal.questions import ask
from benchtool.commands.terminal.tables import Output, print_table
from benchtool.core.errors import InputError
from benchtool.core.inputs import changed, items, make
from benchtool.core.rig import Rig
from benchtool.core.rig_file import rig_from_toml, rig_named
from benchtool.data.column_map import column_map_to_toml
from benchtool.data.csv_text import read_csv_header
from benchtool.data.formats.formats import import_file, is_stand_table
from benchtool.data.run.read import is_run
from benchtool.data.run.run_rig import rig_of_data
from benchtool.data.table import read_table
from benchtool.physics.model_file import model_names, stated_in
from benchtool.report.page import Table

MODEL = "single"
"""The model of a table where none is named: one rotor over a plate."""


def prepare_table(given: dict[str, Any]) -> tuple[str, ...]:
    """Complete what was given to `benchtool fit` for a table: its map, rig, model and basis.

    Nothing is done where a run is fitted, or where a map or a model file says what columns are.

    Args:
        given: inputs by name, changed in place.

    Returns:
        Filters COLUMN=VALUE of runs in the table that are to be fitted one by one.

    Raises:
        InputError: something is open and nobody is at a terminal.
    """
    names = {item.name for item in items(TableInputs)}
    table = make(TableInputs, {name: given[name] for name in names & given.keys()}, source="option")
    paths = [path for path in given.get("data", ()) if Path(path).is_file()]
    if not all(Path(path).exists() for path in given.get("data", ())):
        return ()  # reading them says which one is missing
    if not paths or len(paths) < len(given["data"]) or any(map(is_run, paths)):
        if changed(table):
            raise InputError(
                "columns of a table are named, but the data are no table; leave them out"
            )
        return ()
    first = str(paths[0])
    known = is_stand_table(first) and not changed(table) - {"radius": 0}.keys()
    given.setdefault("model", MODEL)
    if not changed(table) and not known and _is_described(given, first):
        return ()
    rig, rig_text = _rig(given, table, first, known)
    where = tuple(given.get("where", ()))
    if known:
        _write_rig(given, first, rig_text)
        return ()
    if given.get("columns") is not None:
        _write_rig(given, first, rig_text)
        if changed(table).keys() - {"radius", "runs"}:
            raise InputError("--map says which column is which; leave the other columns out")
        return ()
    choice = choose_columns(first, table, rig, where)
    one = tuple(f"{choice.run_column}={name}" for name in choice.runs)
    _show(first, choice, (*where, *one[:1]))
    if _is_terminal() and ask("Is this right", "", usual="yes", choices=("yes", "no")) == "no":
        raise InputError("nothing was written; say which column is which with --z, --thrust, ...")
    _write_rig(given, first, rig_text)
    given["columns"] = str(
        _written(f"{Path(first).stem}.columns", column_map_to_toml(choice.columns))
    )
    if choice.has_ratios:
        given["basis"] = given.get("basis") or "equal_rpm2"
    if any(name.endswith(("_sd", "_sd_N")) for name in choice.columns):
        given.setdefault("noise", "scale")
    return one


def _is_terminal() -> bool:
    import sys

    return sys.stdin.isatty()


def _own_model(given: Mapping[str, Any]) -> str:
    """Return the path of a user's model file; empty for a shipped one."""
    model = str(given["model"])
    return "" if model in model_names() else model


def _is_described(given: Mapping[str, Any], first: str) -> bool:
    """Return whether a map, a model file or the header says what the columns are."""
    if given.get("columns") is not None:
        return True
    if (own := _own_model(given)) and stated_in(own)[1]:
        return True
    header = read_csv_header(Path(first))
    return "thrust_N" in header or "thrust_ratio" in header


def _rig(given: Mapping[str, Any], table: TableInputs, first: str, known: bool) -> tuple[Rig, str]:
    """Return the rig of a table, and the text of its file where it is of a radius alone."""
    if (named := given.get("rig")) is not None:
        if table.radius is not None:
            raise InputError("--radius and --rig are both given; give one of them")
        return rig_named(named), ""
    if table.radius is None and (own := rig_of_data([first])) is not None:
        return own, ""
    if table.radius is None and (model := _own_model(given)):
        return stated_in(model)[0], ""
    text = radius_rig(first, table.radius, known=known)
    if not text:
        reason = f"{first} does not say how large the rotor is"
        typed = ask("Rotor radius in m", "--radius, as 127mm or 5in (or --rig FILE)", reason=reason)
        radius_m = make(TableInputs, {"radius": typed}, source="option").radius
        text = radius_rig(first, radius_m, known=known)
    return rig_from_toml(text, f"rig of {first}"), text


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


def _write_rig(given: dict[str, Any], first: str, text: str) -> None:
    """Write a rig of a radius alone and name its file."""
    if text:
        given["rig"] = str(_written(f"{Path(first).stem}.rig", text))


def _written(stem: str, text: str) -> Path:
    """Return a file of this text in the present folder: one that is there, or a new one."""
    number = 1
    while True:
        path = Path(f"{stem}.toml" if number == 1 else f"{stem}-{number}.toml")
        if not path.exists():
            path.write_text(text, encoding="utf-8")
            print(f"written: {path}")
            return path
        if path.read_text(encoding="utf-8", errors="replace") == text:
            return path
        number += 1


def _show(path: str, choice: ColumnChoice, where: tuple[str, ...]) -> None:
    """Print what was understood: channel, column, unit and first values."""
    recording = read_table(path, choice.columns, where)
    console = Output()
    rows = []
    for channel in recording.channels:
        source = choice.columns[channel.name]
        theirs = "one number for all rows" if source.column is None else source.column
        if source.unit is not None and source.column is not None and source.unit not in theirs:
            theirs += f" in {source.unit}"
        if source.factor != 1.0:
            theirs += f" times {source.factor:g} m"
        values = recording.column(channel.name)
        if source.reference is not None:
            shown = f"{int(np.sum(values == values.max()))} rows with {source.reference!r}"
        else:
            shown = first_values(values)
        rows.append((channel.name, theirs, channel.unit, shown))
    head = ("channel", "column", "unit", "first values, in that unit")
    print_table(console, Table(f"{path}: {len(recording)} rows", head, rows, text_columns=4))
    repairs = [text for text in recording.provenance["repairs"].split("; ") if text]
    console.say(*(f"note: {text}" for text in (*choice.notes, *repairs)))
