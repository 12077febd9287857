"""Crazyflie system identification logs: thrust of all four rotors, pwm, speeds, power."""

from __future__ import annotations

from benchtool.data.csv_text import TextTable
from benchtool.data.repairs.column_mapping import map_header, read_columns
from benchtool.data.repairs.import_result import Finding, ImportOptions, ImportResult

CHANNELS: dict[str, str] = {
    "weight": "thrust_N",
    "pwm": "pwm_raw",
    **{name: name for name in ("rpm1", "rpm2", "rpm3", "rpm4")},
    "v": "voltage_V",
    "i": "current_A",
    "p": "power_W",
}
"""Columns of the Crazyflie's `system_id` scripts. The load cell reads the loss of weight, which is
the thrust, in gram-force by default."""


def read_crazyflie(table: TextTable, options: ImportOptions) -> ImportResult:
    """Return a Crazyflie's log: thrust of all four rotors, pwm as the raw number 0 to 65535."""
    loaded = any(cell.startswith("v[") or cell == "v" for cell in table.header)
    channels = {**CHANNELS, "vbat": "battery_V" if loaded else "voltage_V"}
    columns, findings = map_header(table, channels.get, units={"thrust_N": "gf"})
    common = [
        Finding("lacks", "time", "rows are ordered but have no time", count=table.rows_in_file),
        Finding("read as", "pwm", "the raw number 0 to 65535, not a pulse width", "pwm_raw"),
    ]
    facts = {"device": "Crazyflie on a load cell"}
    return read_columns(table, columns, facts, [*common, *findings])
