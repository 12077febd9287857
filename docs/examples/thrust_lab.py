"""Importer of ThrustLab logs: thrust, throttle and speed of one rotor."""

from __future__ import annotations

from benchtool.data.csv_text import TextTable
from benchtool.data.repairs.column_mapping import map_header, read_columns
from benchtool.data.repairs.import_result import ImportOptions, ImportResult

CHANNELS = {"t": "time_s", "load": "thrust_N", "esc": "pwm1_us", "speed": "rpm1"}


def read_thrust_lab(table: TextTable, options: ImportOptions) -> ImportResult:
    """Return the recording; thrust is in gram-force if the header has no unit."""
    columns, findings = map_header(table, CHANNELS.get, units={"thrust_N": "gf"})
    return read_columns(table, columns, {"device": "ThrustLab stand"}, findings)
