"""Read a CSV without a map where its header says enough: known names, units in brackets."""

from __future__ import annotations

import re
from collections.abc import Mapping

from benchtool.core.channel import require_known_channel
from benchtool.core.errors import FileFormatError, UnknownChoice
from benchtool.data.formats.text_table import lay_out
from benchtool.data.repairs.imported import Imported, Options
from benchtool.data.repairs.mapped import map_header, read_columns

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


def read_named(
    data: bytes, where: str, provenance: Mapping[str, str], options: Options
) -> Imported:
    """Return the columns of a CSV whose names and units are understood.

    A column that names no unit is taken in ours, and a doubt says so.
    """
    table = lay_out(data, where)
    hint = "; --columns MAP.toml says what they are"
    columns, findings = map_header(table, channel_meant, hint=hint)
    if not columns:
        unknown = ", ".join(list(filter(None, table.header))[:12])
        raise FileFormatError(
            where,
            f"none of its columns is known ({unknown}); say which is which with --columns MAP.toml",
        )
    return read_columns(table, columns, "named columns", provenance, findings)
