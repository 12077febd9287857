"""Points of hover flights, and tables that come as Parquet."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from benchtool.core.errors import InputError
from benchtool.data.formats.formats import import_file
from benchtool.data.repairs.import_result import ImportOptions

MAP = """[columns]
time_s = "t"
plate_z_m = { column = "z", unit = "mm" }
rpm1 = "n1"
rpm2 = "n2"
"""
RATE_HZ = 50


def flight(path: Path, height_m: np.ndarray, speed: np.ndarray) -> ImportOptions:
    """Write a flight as Parquet, and give the options that read it."""
    time_s = np.arange(len(height_m)) / RATE_HZ
    columns = {"t": time_s, "z": 1e3 * height_m, "n1": speed, "n2": 2.0 * speed}
    pq.write_table(pa.table(columns), path)
    (path.parent / "map.toml").write_text(MAP)
    return ImportOptions(columns=path.parent / "map.toml", hover_kg=2.0)


def test_thrust_of_a_hover_is_mass_times_gravity_and_acceleration(tmp_path):
    """Two seconds of rest, then one of a parabola whose turning point lies in its middle."""
    since_s = np.arange(3 * RATE_HZ) / RATE_HZ
    middle_s = since_s[2 * RATE_HZ :].mean()
    rising = np.where(since_s < 2.0, 0.0, 0.5 * 0.4 * (since_s - middle_s) ** 2)
    speed = np.linspace(3000.0, 5000.0, RATE_HZ)
    path = tmp_path / "hover.parquet"
    points = import_file(path, flight(path, 0.3 + rising, np.tile(speed, 3))).recording
    assert points.column("thrust_N") == pytest.approx(
        [2.0 * 9.80665, 2.0 * 9.80665, 2.0 * (9.80665 + 0.4)]
    )
    assert points.column("plate_z_m")[:2] == pytest.approx([0.3, 0.3])
    assert points.column("rpm1") == pytest.approx(np.sqrt(np.mean(speed**2)))


@pytest.mark.parametrize(
    ("climb_m_s", "speed", "steady"), [(0.04, 4000.0, 4), (0.06, 4000.0, 0), (0.0, 0.0, 0)]
)
def test_only_steady_stays_with_turning_rotors_are_points(tmp_path, climb_m_s, speed, steady):
    count = 4 * RATE_HZ
    path = tmp_path / "hover.parquet"
    height = 1.0 + climb_m_s * np.arange(count) / RATE_HZ
    options = flight(path, height, np.full(count, speed))
    if steady:
        assert len(import_file(path, options).recording) == steady
    else:
        with pytest.raises(InputError, match="no 1 s of the flight with all rotors"):
            import_file(path, options)


def test_a_table_without_heights_is_no_hover(tmp_path):
    (tmp_path / "a.csv").write_text("thrust_N,rpm1\n1,2000\n2,3000\n")
    with pytest.raises(InputError, match="--hover needs time_s, plate_z_m and rpm1"):
        import_file(tmp_path / "a.csv", ImportOptions(hover_kg=1.0))
