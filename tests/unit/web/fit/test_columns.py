"""Column maps of tables: suggestions, form values and rejected maps."""

from __future__ import annotations

import pytest

from benchtool.core.channel import ColumnSource
from benchtool.core.errors import FileFormatError, InputError, MissingColumn
from benchtool.data.run.runs_folder import column_map_path
from benchtool.web.cards.data import allowed_units, check_columns, displayed_unit, load_columns
from benchtool.web.entries import store_columns


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "lab.csv"
    path.write_text("gap (mm),Thrust (gf),rpm,note\n60,-424.1,5500,a\n90,-362.6,5500,b\n", "utf-8")
    return path


def test_a_header_suggests_columns_and_units_of_the_same_kind(table):
    assert load_columns(table) == {
        "plate_z_m": ColumnSource(column="gap (mm)", unit="mm"),
        "thrust_N": ColumnSource(column="Thrust (gf)", unit="gf"),
        "rpm1": ColumnSource(column="rpm"),
    }
    assert allowed_units("thrust_N")[0] == "N"
    assert {"gf", "lbf"} <= set(allowed_units("thrust_N"))
    assert "mm" not in allowed_units("thrust_N")
    cells = ("Thrust_kg", "Thrust (bar)", "n (1/s)")
    channels = ("thrust_N", "thrust_N", "rpm1")
    assert [*map(displayed_unit, channels, cells)] == ["kgf", None, "1/s"]


def test_columns_that_cannot_be_read_are_refused_and_not_stored(table):
    wrong = {"thrust_N": ColumnSource(column="note"), "rpm1": ColumnSource(constant=1.0)}
    with pytest.raises(FileFormatError, match=r"line 2: column 'note' contains 'a'"):
        store_columns(table.parent, "lab.csv", wrong)
    with pytest.raises(MissingColumn, match=r"names 'x', which .*lab\.csv lacks"):
        store_columns(table.parent, "lab.csv", {"thrust_N": ColumnSource(column="x")})
    with pytest.raises(InputError, match="is outside the runs folder"):
        store_columns(table.parent, "../lab.csv", wrong)
    assert not column_map_path(table).exists()


def test_a_map_needs_thrust_and_a_speed():
    with pytest.raises(InputError, match="thrust_N has no column"):
        check_columns({"rpm1": ColumnSource(column="rpm")})
    with pytest.raises(InputError, match="neither rpm1 nor pwm1_us"):
        check_columns({"thrust_N": ColumnSource(column="F"), "rpm1": None})
