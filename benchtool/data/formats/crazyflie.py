"""Crazyflie system identification: weight of the whole quadrotor, pwm, speeds, voltage, current."""

from __future__ import annotations

from collections.abc import Mapping

from benchtool.core.channel import unit_told_by
from benchtool.data.formats.text_table import lay_out
from benchtool.data.repairs.foreign_units import Conversion, conversion, head_of
from benchtool.data.repairs.imported import Finding, Imported
from benchtool.data.repairs.mapped import Mapped, read_mapped

CHANNELS: dict[str, str] = {
    "weight": "thrust_N",
    "pwm": "pwm_raw",
    "vbat": "battery_V",
    "rpm1": "rpm1",
    "rpm2": "rpm2",
    "rpm3": "rpm3",
    "rpm4": "rpm4",
    "v": "voltage_V",
    "i": "current_A",
    "p": "power_W",
}
"""Columns of the Crazyflie's `system_id` scripts. The load cell shows how much lighter the vehicle
gets: that is its thrust, in gram-force where no unit stands."""

UNITLESS = {"thrust_N": "gf"}


def is_crazyflie(first_line: str) -> bool:
    """Tell whether a header is that of a Crazyflie on a load cell."""
    names = {head_of(cell).name for cell in first_line.lstrip("\ufeff").split(",")}
    return {"weight", "pwm", "rpm1", "rpm4"} <= names


def read_crazyflie(data: bytes, where: str, provenance: Mapping[str, str]) -> Imported:
    """Return a Crazyflie's log: thrust of all four rotors, pwm as the raw number 0 to 65535."""
    table = lay_out(data, where)
    findings: list[Finding] = [
        Finding("lacks", "time", "rows have an order and no time", count=table.rows_in_file),
        Finding("read as", "pwm", "the raw number 0 to 65535, not a pulse width", "pwm_raw"),
    ]
    columns: list[Mapped] = []
    others: list[str] = []
    names = {head_of(cell).name for cell in table.header}
    for position, cell in enumerate(table.header):
        head = head_of(cell)
        name = CHANNELS.get(head.name)
        if name == "battery_V" and "v" not in names:
            name = "voltage_V"
        if name is None:
            others += [cell] if cell else []
            continue
        unit = unit_told_by(name)
        theirs = head.unit if head.unit is not None else UNITLESS.get(name, unit)
        if head.unit is None and name in UNITLESS:
            words = f"{cell!r} names none; read as {theirs}, as the scripts write it"
            findings.append(Finding("doubt", "unit", words, name))
        scale = Conversion(1.0) if name == "pwm_raw" else conversion(theirs, unit)
        columns.append(Mapped(name=name, position=position, conversion=scale, source=cell))
    if others:
        words = f"unknown: {', '.join(others)}"
        findings.append(Finding("left out", "columns", words, count=len(others)))
    facts = {**provenance, "device": "Crazyflie on a load cell"}
    return read_mapped(table, columns, "Crazyflie system_id", facts, findings)
