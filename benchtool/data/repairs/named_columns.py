"""Read a CSV without a map where its header says enough: known names, units in brackets."""

from __future__ import annotations

import re
from collections.abc import Mapping

from benchtool.core.channel import require_known_channel, unit_told_by
from benchtool.core.errors import FileFormatError, InputError, UnknownChoice
from benchtool.data.formats.text_table import lay_out
from benchtool.data.repairs.foreign_units import conversion, head_of
from benchtool.data.repairs.imported import Finding, Imported
from benchtool.data.repairs.mapped import Mapped, read_mapped

NAMES: dict[str, str] = {
    "t": "time_s",
    "time": "time_s",
    "thrust": "thrust_N",
    "torque": "torque_Nm",
    "voltage": "voltage_V",
    "current": "current_A",
    "electrical power": "power_W",
    "mechanical power": "mechanical_power_W",
    "rpm": "rpm1",
    "rotation speed": "rpm1",
    "pwm": "pwm1_us",
    "throttle": "pwm1_us",
    "theta": "theta_rad",
    "theta_ref": "theta_ref_rad",
    "gyro": "gyro_rad_s",
    "plate_z": "plate_z_m",
    "vibration": "vibration_m_s2",
}
"""Names that people give to columns, in small letters, and the channel that they mean."""


def channel_meant(name: str) -> str | None:
    """Return the channel that a column's name means; None where nobody can know."""
    if re.fullmatch(r"pwm\d+", name):
        return f"{name}_us"
    try:
        require_known_channel(name)
    except UnknownChoice:
        return NAMES.get(name.lower())
    return name


def read_named(data: bytes, where: str, provenance: Mapping[str, str]) -> Imported:
    """Return the columns of a CSV whose names and units are understood.

    A column that names no unit is taken in ours, and a doubt says so.
    """
    table = lay_out(data, where)
    columns: list[Mapped] = []
    findings: list[Finding] = []
    others: list[str] = []
    unitless: list[str] = []
    for position, cell in enumerate(table.header):
        head = head_of(cell)
        name = channel_meant(head.name)
        if name is None or name in {column.name for column in columns}:
            others += [cell] if cell else []
            continue
        unit = unit_told_by(name)
        try:
            scale = conversion(unit if head.unit is None else head.unit, unit)
        except InputError as error:
            raise FileFormatError(f"{where}, column {cell!r}", str(error)) from error
        if head.unit is None and head.name != name and unit != "rpm":
            unitless.append(f"{cell} as {unit}")
        columns.append(Mapped(name=name, position=position, conversion=scale, source=cell))
    if not columns:
        raise FileFormatError(
            where,
            f"none of its columns is known ({', '.join(others[:12])}); say which is which with "
            f"--columns MAP.toml",
        )
    if unitless:
        words = f"the header names none; read {', '.join(unitless)}"
        findings.append(Finding("doubt", "units", words, count=len(unitless)))
    if others:
        words = f"unknown: {', '.join(others)}; --columns MAP.toml says what they are"
        findings.append(Finding("left out", "columns", words, count=len(others)))
    return read_mapped(table, columns, "named columns", provenance, findings)
