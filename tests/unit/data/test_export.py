from __future__ import annotations

import csv
from hashlib import sha256
from io import BytesIO
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from benchtool.core.errors import FileFormatError, UnknownChoice
from benchtool.data.parquet import read_parquet
from benchtool.data.run.read import read_points, read_samples
from benchtool.data.run.run import read_settings
from benchtool.data.run.settings import SUFFIXES, TABLES, exported
from tests.unit.data.run_of import small_run


def test_a_table_that_stands_on_the_disk_is_handed_on_as_it_is(tmp_path: Path) -> None:
    run = small_run(tmp_path / "run")
    run.close()
    for name in ("settings.csv", "samples.csv", "samples.parquet"):
        table, suffix = name.split(".")
        assert exported(run.path, table, f".{suffix}") == (run.path / name).read_bytes()


def test_exported_points_have_the_columns_on_the_disk_and_quantities_behind_them() -> None:
    run = Path(__file__).parents[3] / "datasets" / "quad" / "run"
    own = [line.split(",") for line in (run / "points.csv").read_text().splitlines()]
    wide = [line.split(",") for line in exported(run, "points", ".csv").decode().splitlines()]
    assert wide[0][: len(own[0])] == own[0]
    assert {"ct", "ct_se", "tip_mach"} <= set(wide[0][len(own[0]) :])
    thrust = own[0].index("thrust_N")
    assert [line[thrust] for line in wide] == [line[thrust] for line in own]


def test_what_is_not_on_the_disk_is_made_with_the_same_numbers(tmp_path: Path) -> None:
    run = small_run(tmp_path / "run")  # not closed: neither settings nor Parquet
    made = tmp_path / "made.parquet"
    made.write_bytes(exported(run.path, "samples", ".parquet"))
    np.testing.assert_array_equal(read_parquet(made).values, read_samples(run.path).values)
    made.write_bytes(exported(run.path, "points", ".parquet"))
    assert len(read_parquet(made)) == len(read_points(run.path)) + 1  # and the tare
    settings = exported(run.path, "settings", ".csv")
    run.close()
    assert settings == (run.path / "settings.csv").read_bytes()
    assert len(read_settings(run.path)) == 2
    whole = (run.path / "samples.csv").read_bytes()
    (run.path / "samples.csv").unlink()
    again = BytesIO(exported(run.path, "samples", ".csv")).read()
    assert again.count(b"\n") == whole.count(b"\n")


def test_pyarrow_reads_numbers_units_and_the_hash_of_the_samples(tmp_path: Path) -> None:
    run = small_run(tmp_path / "run")
    run.close()
    table = pq.read_table(run.path / "samples.parquet")
    with (run.path / "samples.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for name in ("time_s", "device_time_us", "pwm1_us", "rpm1", "thrust_N"):
        cells = [float(row[name]) if row[name] else None for row in rows]
        assert [None if one is None or one != one else one for one in table[name].to_pylist()] == [
            pytest.approx(one, rel=0, abs=0) if one is not None else None for one in cells
        ]
    facts = table.schema.metadata
    units = {"time_s": b"s", "device_time_us": b"us", "rpm1": b"rpm", "thrust_N": b"N"}
    assert {name: facts[f"unit:{name}".encode()] for name in units} == units
    stated = sha256((run.path / "samples.csv").read_bytes()).hexdigest().encode()
    assert facts[b"provenance:sha256"] == stated


def test_a_table_that_nobody_knows_is_refused(tmp_path: Path) -> None:
    run = small_run(tmp_path / "run")
    with pytest.raises(UnknownChoice, match="known: points, samples, settings"):
        exported(run.path, "../metadata", ".csv")
    with pytest.raises(UnknownChoice):
        exported(run.path, "points", ".json")
    (run.path / "samples.csv").unlink()
    with pytest.raises(FileFormatError, match="no samples in it"):
        exported(run.path, "samples", ".csv")
    assert (len(TABLES), len(SUFFIXES)) == (3, 3)
