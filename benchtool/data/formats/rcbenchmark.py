"""Logs of RCbenchmark and Tyto stands, series 1520, 1580/1585 and 1780.

Columns are found by name, so extra columns, older names and other delimiters are accepted. The unit
of thrust is the one selected by the user.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from benchtool.core.units import Array
from benchtool.data.column_map import MappedColumn, parse_header_cell
from benchtool.data.csv_text import parse_rows
from benchtool.data.repairs.column_mapping import map_header, read_columns
from benchtool.data.repairs.import_result import Finding, ImportOptions, ImportResult

ELECTRICAL, OPTICAL = "Motor Electrical Speed", "Motor Optical Speed"

CHANNELS: dict[str, str] = {  # columns of the stands by name, as in their exports of 2017 to 2023
    "Time": "time_s",
    "ESC signal": "pwm1_us",
    "ESC": "pwm1_us",
    "Servo": "servo1_us",
    "Servo 1": "servo1_us",
    "Servo 2": "servo2_us",
    "Servo 3": "servo3_us",
    "AccX": "acc_x_m_s2",
    "AccY": "acc_y_m_s2",
    "AccZ": "acc_z_m_s2",
    "Temp": "temperature_degC",
    "Torque": "torque_Nm",
    "Thrust": "thrust_N",
    "Voltage": "voltage_V",
    "Current": "current_A",
    ELECTRICAL: "rpm1",
    OPTICAL: "rpm1_optical",
    "Electrical Power": "power_W",
    "Mechanical Power": "mechanical_power_W",
    "Motor Efficiency": "motor_efficiency",
    "Propeller Mech. Efficiency": "propeller_efficiency_N_W",
    "Overall Efficiency": "efficiency_N_W",
    "Vibration": "vibration_m_s2",
}


def read_rcbenchmark(data: bytes, where: str, options: ImportOptions) -> ImportResult:
    """Return a stand's log."""
    table = parse_rows(data, where)
    columns, findings = map_header(
        table, lambda name: CHANNELS.get("Temp" if name.endswith("Temp") else name), refuse=False
    )
    names = {parse_header_cell(cell).name for cell in table.header}
    if "AccX" in names:
        series = "Series 1580/1585"
    else:
        series = "Series 1780" if "Torque" in names else "Series 1520"
    name = f"RCbenchmark {series}"
    return read_columns(table, columns, name, {"device": name}, findings, _select_speed)


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
