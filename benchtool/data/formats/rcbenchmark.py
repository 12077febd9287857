"""Logs of RCbenchmark and Tyto stands, series 1520, 1580/1585 and 1780, as their program saves.

The columns are known by name, so logs with a script's own columns, older wording or a spreadsheet's
`;` read alike. Thrust stands in whatever unit the user chose to see.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.channel import unit_told_by
from benchtool.core.errors import InputError
from benchtool.data.formats.text_table import lay_out
from benchtool.data.repairs.foreign_units import Conversion, Head, conversion, head_of
from benchtool.data.repairs.imported import Finding, Imported
from benchtool.data.repairs.mapped import Mapped, read_mapped

Array = NDArray[np.float64]

ELECTRICAL, OPTICAL = "Motor Electrical Speed", "Motor Optical Speed"

CHANNELS: dict[str, str] = {
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
    "Torque": "torque_Nm",
    "Thrust": "thrust_N",
    "Voltage": "voltage_V",
    "Current": "current_A",
    ELECTRICAL: "rpm1",
    OPTICAL: "rpm1_optical",
    "Electrical Power": "power_W",
    "Mechanical Power": "mechanical_power_W",
    "Vibration": "vibration_m_s2",
}
"""Columns of the stands by name, as in their exports of 2017 to 2023."""

DERIVED = ("Motor Efficiency", "Propeller Mech. Efficiency", "Overall Efficiency")
"""Left out: quotients of other columns."""


def is_rcbenchmark(first_line: str) -> bool:
    """Tell whether a header is one of these stands'."""
    delimiter = max(",;\t", key=first_line.count)
    names = {head_of(cell).name for cell in first_line.lstrip("\ufeff").split(delimiter)}
    return {"Time", "Thrust"} <= names and bool(names & {"ESC", "ESC signal"})


def series_of(names: set[str]) -> str:
    """Return which stand writes these columns."""
    if "AccX" in names:
        return "Series 1580/1585"
    return "Series 1780" if "Torque" in names else "Series 1520"


def read_rcbenchmark(data: bytes, where: str, provenance: Mapping[str, str]) -> Imported:
    """Return a stand's log."""
    table = lay_out(data, where)
    heads = [head_of(cell) for cell in table.header]
    findings: list[Finding] = []
    columns: list[Mapped] = []
    others: list[str] = []
    quotients: list[str] = []
    for position, head in enumerate(heads):
        name = CHANNELS.get(head.name)
        if name is None and head.name.endswith("Temp") and head.unit:
            name = "temperature_degC"
        if name is None or name in {column.name for column in columns}:
            if head.name in DERIVED:
                quotients.append(head.name)
            elif head.name:
                others.append(head.name)
            continue
        columns.append(_mapped(table.header[position], head, position, name, findings))
    if others:
        words = f"columns of a script, or unknown: {', '.join(others)}"
        findings.append(Finding("left out", "columns", words, count=len(others)))
    if quotients:
        words = f"quotients of thrust, power and torque, which are kept: {', '.join(quotients)}"
        findings.append(Finding("left out", "efficiencies", words, count=len(quotients)))
    series = series_of({head.name for head in heads})
    facts = {**provenance, "device": f"RCbenchmark {series}"}
    return read_mapped(table, columns, f"RCbenchmark {series}", facts, findings, _one_speed)


def _mapped(cell: str, head: Head, position: int, name: str, findings: list[Finding]) -> Mapped:
    unit = unit_told_by(name)
    if name.startswith("servo"):
        scale = Conversion(1.0)
    else:
        try:
            scale = conversion(head.unit if head.unit is not None else unit, unit)
        except InputError as error:
            findings.append(Finding("doubt", "unit", f"{error}; read as {unit}", name))
            scale = Conversion(1.0)
    if head.unit is None and unit != "1":
        findings.append(Finding("doubt", "unit", f"{cell!r} names none; read as {unit}", name))
    return Mapped(name=name, position=position, conversion=scale, source=cell)


def _one_speed(
    columns: Sequence[Mapped], read: Mapping[str, Array], findings: list[Finding]
) -> list[Mapped]:
    """Take the optical probe for the speed where only that one lives; tell dead ones."""
    lives = {
        name: bool(np.any(read[name] > 0.0)) for name in ("rpm1", "rpm1_optical") if name in read
    }
    kept: list[Mapped] = []
    for column in columns:
        if lives.get(column.name, True):
            optical_only = column.name == "rpm1_optical" and not lives.get("rpm1")
            kept.append(replace(column, name="rpm1") if optical_only else column)
            continue
        words = f"{column.source} is 0 or blank in every row and left out"
        count = len(read[column.name])
        findings.append(Finding("left out", "dead channel", words, column.name, count))
    if not any(lives.values()):
        words = "no speed was measured; thrust can only be held against the ESC signal"
        findings.append(Finding("lacks", "rpm", words))
    return kept
