from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.channel import ColumnSource
from benchtool.core.errors import (
    BenchtoolError,
    FileFormatError,
    InputError,
    MissingColumn,
    UnknownChoice,
)
from benchtool.data.table import read_table

TEXT = """series,z_over_R,Fz,note
Fz0,0.5,1000,first
Fz0,1.0,-500,
Fz30,0.5,700,
"""


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "pairs.csv"
    file.write_text(TEXT)
    return file


def test_columns_are_mapped_converted_and_filtered(path):
    recording = read_table(
        path,
        {
            "thrust_N": {"column": "Fz", "unit": "gf", "sign": -1},
            "plate_z_m": ColumnSource(column="z_over_R", factor=0.2),
            "rpm1": {"constant": 6300.0, "unit": "rpm"},
        },
        ["series=Fz0"],
    )
    assert recording.names == ("thrust_N", "plate_z_m", "rpm1")
    assert [channel.unit for channel in recording.channels] == ["N", "m", "rpm"]
    np.testing.assert_allclose(recording.column("thrust_N"), [-9.80665, 4.903325], rtol=1e-12)
    np.testing.assert_allclose(recording.column("plate_z_m"), [0.1, 0.2], rtol=1e-12)
    assert recording.column("rpm1").tolist() == [6300.0, 6300.0]
    assert recording.provenance["where"] == "series=Fz0"
    assert len(recording.provenance["sha256"]) == 64


@pytest.mark.parametrize(
    ("columns", "where", "kind", "message"),
    [
        ({"thrust_N": "Thrust"}, [], MissingColumn, r"\[columns\] names 'Thrust', which .* lacks"),
        ({"thrust_N": "note"}, [], FileFormatError, r"line 2: column 'note' contains 'first'"),
        ({"thrust_N": "Fz"}, ["series=x"], FileFormatError, "the column contains: Fz0, Fz30"),
        ({"thrust_N": "Fz"}, ["sweep=x"], UnknownChoice, "unknown column of .* 'sweep'"),
        ({"thrust_N": "Fz"}, ["series"], InputError, "COLUMN=VALUE"),
        ({"thrust_N": {"column": "Fz", "unit": "V"}}, [], InputError, "not a unit of force"),
        ({"thrust_N": {"column": "Fz", "unit": "foo"}}, [], InputError, "unit 'foo' is unknown"),
        ({"thrust_N": {"column": "Fz", "unti": "N"}}, [], UnknownChoice, "did you mean 'unit'"),
        ({"thrust_N": {"unit": "N"}}, [], BenchtoolError, "exactly one of them"),
    ],
)
def test_what_does_not_fit_is_refused(path, columns, where, kind, message):
    with pytest.raises(kind, match=message):
        read_table(path, columns, where)


@pytest.mark.parametrize("cell", ["1e308", "-1e308", "1e400", "inf", "-inf"])
def test_a_number_that_no_bench_measures_is_refused_with_its_line(tmp_path, cell):
    file = tmp_path / "a.csv"
    file.write_text(f"thrust_N,rpm1\n1.0,5000\n{cell},5000\n")
    with pytest.raises(FileFormatError, match="thrust_N is") as refused:
        read_table(file)
    assert refused.value.where == f"{file}, line 3"


@pytest.mark.parametrize("column", ["thrust_se_N", "thrust_sd_N", "rpm1_se"])
@pytest.mark.parametrize("cell", ["-0.005", "1e-308"])
def test_a_standard_error_below_0_is_refused_with_its_line(tmp_path, column, cell):
    file = tmp_path / "a.csv"
    file.write_text(f"thrust_N,{column}\n1.0,0.005\n-1.0,{cell}\n")
    with pytest.raises(FileFormatError, match=f"{column} is {float(cell):g}") as refused:
        read_table(file)
    assert refused.value.where == f"{file}, line 3"
    file.write_text(f"thrust_N,{column}\n1.0,0.005\n-1.0,\n")
    assert np.isnan(read_table(file).column(column)).tolist() == [False, True]
