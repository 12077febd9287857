from __future__ import annotations

from io import BytesIO

import numpy as np

from benchtool.data.parquet import read_parquet
from benchtool.data.run.points import export_table
from benchtool.data.run.read import read_points, read_samples
from benchtool.data.run.run import read_settings
from tests.unit.data.run_of import small_run


def test_what_is_not_on_the_disk_is_made_with_the_same_numbers(tmp_path):
    run = small_run(tmp_path / "run")  # not closed: neither settings nor Parquet
    made = tmp_path / "made.parquet"
    made.write_bytes(export_table(run.path, "samples", ".parquet"))
    np.testing.assert_array_equal(read_parquet(made).values, read_samples(run.path).values)
    made.write_bytes(export_table(run.path, "points", ".parquet"))
    assert len(read_parquet(made)) == len(read_points(run.path)) + 1  # and the tare
    settings = export_table(run.path, "settings", ".csv")
    run.close()
    assert settings == (run.path / "settings.csv").read_bytes()
    assert len(read_settings(run.path)) == 2
    whole = (run.path / "samples.csv").read_bytes()
    (run.path / "samples.csv").unlink()
    again = BytesIO(export_table(run.path, "samples", ".csv")).read()
    assert again.count(b"\n") == whole.count(b"\n")
