"""A table's columns: what its header tells, what the form asks, what is refused and told."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchtool.core.column_source import ColumnSource
from benchtool.core.errors import FileFormatError, InputError, MissingColumn
from benchtool.data.run.runs_folder import columns_file
from benchtool.physics.model_file import read_columns
from benchtool.web.tabs.fit.columns import (
    FIT_CHANNELS,
    ColumnLine,
    columns_of,
    guessed,
    lines_for,
    units_for,
)
from benchtool.web.tabs.fit.work import store_columns

TEXT = "gap (mm),Thrust (gf),rpm,note\n60,-424.1,5500,a\n90,-362.6,5500,b\n"


@pytest.fixture
def table(tmp_path: Path) -> Path:
    path = tmp_path / "lab.csv"
    path.write_text(TEXT, "utf-8")
    return path


def test_a_header_tells_what_it_can(table: Path) -> None:
    found = guessed(("gap (mm)", "Thrust (gf)", "rpm", "note", "plate_z_m", "thrust_N"))
    assert found == {
        "thrust_N": ColumnSource(column="Thrust (gf)", unit="gf"),
        "rpm1": ColumnSource(column="rpm"),
        "plate_z_m": ColumnSource(column="plate_z_m"),
    }
    lines = {line.channel: line for line in lines_for(table)}
    assert tuple(lines) == FIT_CHANNELS
    assert lines["thrust_N"] == ColumnLine(channel="thrust_N", column="Thrust (gf)", unit="gf")
    assert lines["plate_z_m"] == ColumnLine(channel="plate_z_m", unit="m")


def test_units_are_of_the_same_kind() -> None:
    assert units_for("thrust_N")[0] == "N"
    assert {"gf", "lbf"} <= set(units_for("thrust_N"))
    assert "mm" not in units_for("thrust_N")


def test_a_map_is_kept_and_tells_what_it_gives(table: Path) -> None:
    columns = columns_of(
        [
            ColumnLine(channel="thrust_N", column="Thrust (gf)", unit="gf", reversed=True),
            ColumnLine(channel="plate_z_m", column="gap (mm)", unit="mm"),
            ColumnLine(channel="rpm1", constant=5500.0, unit="rpm"),
            ColumnLine(channel="voltage_V", unit="V"),
        ]
    )
    shown = store_columns(table.parent, "lab.csv", columns)
    for cell in ("thrust_N", "2 rows as they will be fitted.", "3.556", "4.159"):
        assert cell in shown[0].html
    assert dict(read_columns(columns_file(table))) == columns
    again = {line.channel: line for line in lines_for(table)}
    assert again["thrust_N"].reversed
    assert again["rpm1"].constant == 5500.0


def test_what_cannot_be_read_is_told_and_not_kept(table: Path) -> None:
    wrong = {"thrust_N": ColumnSource(column="note"), "rpm1": ColumnSource(constant=1.0)}
    with pytest.raises(FileFormatError, match=r"line 2: column 'note' holds 'a'"):
        store_columns(table.parent, "lab.csv", wrong)
    with pytest.raises(MissingColumn, match=r"names 'x', which .*lab\.csv lacks"):
        store_columns(table.parent, "lab.csv", {"thrust_N": ColumnSource(column="x")})
    with pytest.raises(InputError, match="leads out of the runs folder"):
        store_columns(table.parent, "../lab.csv", wrong)
    assert not columns_file(table).exists()


def test_a_map_needs_thrust_and_a_speed() -> None:
    with pytest.raises(InputError, match="no column is thrust_N"):
        columns_of([ColumnLine(channel="rpm1", column="rpm")])
    with pytest.raises(InputError, match="neither rpm1 nor pwm1_us"):
        columns_of([ColumnLine(channel="thrust_N", column="F")])
