"""Bounds on rows, columns and bytes of a table; wide tables are rejected quickly."""

from __future__ import annotations

import time

import numpy as np
import pytest

from benchtool.core.channel import Channel
from benchtool.core.errors import FileFormatError
from benchtool.core.recording import Recording
from benchtool.core.user_file import MAX_CELLS
from benchtool.data.columns import check_numbers
from benchtool.data.csv_text import parse_csv, parse_rows
from benchtool.data.parquet import read_parquet, write_parquet

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")


def wide(columns: int) -> bytes:
    return (
        ",".join(f"c{k}" for k in range(columns)) + "\n" + ",".join(["1"] * columns) + "\n"
    ).encode()


@pytest.mark.parametrize("read", [parse_csv, parse_rows])
def test_a_table_of_a_million_columns_is_refused_at_once(read):
    began = time.process_time()
    with pytest.raises(FileFormatError, match=r"t\.csv: it has 1,000,000 columns, limit 4,096"):
        read(wide(1_000_000), "t.csv")
    assert time.process_time() - began < 2.0


def test_a_table_of_too_many_cells_is_refused(monkeypatch):
    monkeypatch.setattr("benchtool.core.user_file.MAX_CELLS", 100)
    rows = b"a,b\n" + b"1,2\n" * 60
    with pytest.raises(FileFormatError, match=r"it has 122 cells, limit 100; keep the rows"):
        parse_csv(rows, "t.csv")
    assert MAX_CELLS > 1_000_000


def test_a_small_parquet_file_of_much_data_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "samples.parquet"
    table = pa.table({f"c{k}": pa.array(np.ones(1_000_000)) for k in range(8)})
    pq.write_table(table, path, compression="zstd")  # equal numbers take little space
    assert path.stat().st_size < 200_000
    monkeypatch.setattr("benchtool.core.user_file.MAX_DECODED_BYTES", 50_000_000)
    with pytest.raises(FileFormatError, match=r"1,000,000 rows of 8 columns take 0\.1 GB when"):
        read_parquet(path)


@pytest.mark.parametrize(
    ("name", "column", "says"),
    [
        ("thrust_N", ["a"], "has the wrong type string"),
        ("thrust_N", [b"a"], "has the wrong type binary"),
        ("thrust_N", [[1.0]], "has the wrong type list<.*double>"),
        ("thrust_N", [{"a": 1}], "has the wrong type struct<a: int64>"),
        ("phase", ["sample", "x"], "contains 'x'; allowed"),
    ],
    ids=["text", "bytes", "list", "struct", "unknown word"],
)
def test_a_parquet_column_that_holds_no_numbers_is_refused(tmp_path, name, column, says):
    pq.write_table(pa.table({name: column}), tmp_path / "r.parquet")
    with pytest.raises(FileFormatError, match=says):
        read_parquet(tmp_path / "r.parquet")


@pytest.mark.parametrize(
    "data", [b"", b"PAR1PAR1", b"PAR1" + b"\0" * 50, b"PAR1\xff\xff\xff\x7fPAR1"]
)
def test_a_broken_parquet_file_is_refused(tmp_path, data):
    (tmp_path / "r.parquet").write_bytes(data)
    with pytest.raises(FileFormatError, match="cannot be read as Parquet"):
        read_parquet(tmp_path / "r.parquet")


def test_words_and_gaps_come_back_from_parquet(tmp_path):
    channels = (Channel("time_s", "s"), Channel("phase", "1"), Channel("thrust_N", "N"))
    values = np.array([[0.0, 5.0, 1.5], [0.1, 4.0, np.nan]])
    write_parquet(tmp_path / "r.parquet", Recording(channels, values))
    np.testing.assert_array_equal(read_parquet(tmp_path / "r.parquet").values, values)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("time_s", np.nan), ("time_s", np.inf), ("time_s", 1e300), ("device_time_us", np.nan),
        ("point", 1.5), ("point", -1.0), ("point", np.nan), ("point", np.inf), ("point", 1e300),
        ("settled", np.nan), ("thrust_N", np.inf),
    ],
)  # fmt: skip
def test_a_number_that_no_run_holds_is_refused(name, value):
    recording = Recording((Channel(name, "1"),), np.array([[1.0], [value]]))
    with pytest.raises(FileFormatError, match=rf"samples\.csv, row 2: {name} is"):
        check_numbers(recording, "samples.csv")
