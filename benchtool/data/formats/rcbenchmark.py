"""Logs of RCbenchmark and Tyto stands, series 1520, 1580/1585 and 1780.

Columns are found by name, so extra columns, older names and other delimiters are accepted. The unit
of thrust is the one selected by the user.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from benchtool.core.units import Array
from benchtool.data.column_map import MappedColumn, match_channel, parse_header_cell
from benchtool.data.csv_text import TextTable
from benchtool.data.repairs.column_mapping import map_header, read_columns
from benchtool.data.repairs.import_result import Finding, ImportOptions, ImportResult

USUAL = {  # columns with the usual names of their channels
    *("Time", "ESC signal", "ESC", "Torque", "Thrust", "Voltage", "Current", "Vibration"),
    *("Motor Electrical Speed", "Electrical Power", "Mechanical Power", "Motor Efficiency"),
    *("Propeller Mech. Efficiency", "Overall Efficiency"),
}
CHANNELS = {  # columns of the stands by name, as in their exports of 2017 to 2023
    **{name: match_channel(name) for name in USUAL},
    **{f"Servo {number}": f"servo{number}_us" for number in (1, 2, 3)},
    **{f"Acc{axis.upper()}": f"acc_{axis}_m_s2" for axis in "xyz"},
    "Servo": "servo1_us",
    "Temp": "temperature_degC",
    "Motor Optical Speed": "rpm1_optical",
}


def read_rcbenchmark(table: TextTable, options: ImportOptions) -> ImportResult:
    """Return a stand's log."""
    columns, findings = map_header(
        table, lambda name: CHANNELS.get("Temp" if name.endswith("Temp") else name), refuse=False
    )
    names = {parse_header_cell(cell).name for cell in table.header}
    if "AccX" in names:
        series = "Series 1580/1585"
    else:
        series = "Series 1780" if "Torque" in names else "Series 1520"
    name = f"RCbenchmark {series}"
    result = read_columns(table, columns, {"device": name}, findings, _select_speed)
    return replace(result, format=name)


def _select_speed(
    columns: Sequence[MappedColumn], values: Mapping[str, Array], findings: list[Finding]
) -> list[MappedColumn]:
    """Drop speed columns without a reading; the optical speed replaces a missing electrical one."""
    is_live = {
        name: bool(np.any(values[name] > 0.0))
        for name in ("rpm1", "rpm1_optical")
        if name in values
    }
    selected: list[MappedColumn] = []
    for column in columns:
        if is_live.get(column.name, True):
            optical_only = column.name == "rpm1_optical" and not is_live.get("rpm1")
            selected.append(replace(column, name="rpm1") if optical_only else column)
            continue
        text = f"{column.source} is 0 or blank in every row"
        count = len(values[column.name])
        findings.append(Finding("left out", "dead channel", text, column.name, count))
    if not any(is_live.values()):
        text = "no speed was measured; thrust can only be compared with the ESC signal"
        findings.append(Finding("lacks", "rpm", text))
    return selected
