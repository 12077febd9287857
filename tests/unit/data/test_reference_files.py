"""All measurement files of the reference data: accepted, repaired, or rejected with a line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchtool.data.formats.formats import import_file
from benchtool.data.repairs.import_result import ImportOptions, ImportResult

ROTOR_PAIRS = """
[columns]
plate_z_m = "z_m"
thrust_N = "Fz"
thrust_sd_N = "Fz_std"
rpm1 = { constant = 6300, unit = "rpm" }
"""

EXPECTED: dict[str, set[str]] = {
    "crazyflie/cf2.1-stock-prop.csv": {"lacks time", "read as pwm", "doubt untared"},
    "crazyflie/cf21_stock2.csv": {"lacks time", "read as pwm"},
    "crazyflie/dead_channel_first_400_lines.csv": {
        "lacks time", "read as pwm", "repaired spikes", "doubt dead channel", "doubt rpm ratio",
    },
    "crazyflie/eckart1.csv": {"lacks time", "read as pwm", "doubt unit"},
    "ground_effect/rotor_pairs.csv": {"repaired line ends", "left out columns"},
    "rcbenchmark_1520/m8_11.csv": {"doubt wrong sign"},
    "rcbenchmark_1580/Log_2019-11-05_171350.csv": {"read as blank cells", "lacks blank columns"},
    "rcbenchmark_1580/StepsTest20230624_2023-06-24_190243.csv": {"lacks rpm"},
    "rcbenchmark_1580/StepsTest_2020-05-22_102946.csv": {"repaired time goes backwards"},
    "rcbenchmark_1580/StepsTest_2020-06-16_214454.csv": {"doubt impossible efficiency"},
    "rcbenchmark_1580/StepsTest_2020-06-16_214537.csv": {"doubt untared"},
    "rcbenchmark_1580/xNova-SR-ramp.csv": {"doubt wrong sign", "lacks rpm"},
    "rcbenchmark_1580/xNova-SR-steps-up.csv": {"doubt wrong sign"},
    "rcbenchmark_1780/ConstVel_2021-06-18_140435.csv": {
        "doubt untared", "repaired ragged rows", "repaired time starts anew",
    },
    "rcbenchmark_1780/Polar_2021-11-19_170044.csv": {"doubt untared"},
    "rcbenchmark_1780/Run_0_Constant_RPM_2021-11-03_101436.csv": {
        "doubt single row", "repaired ragged rows", "lacks rpm",
    },
    "rcbenchmark_1780/Run_0_Polar_2021-10-15_151643.csv": {
        "left out cells without a name", "repaired time goes backwards",
    },
    "logs/pymavlink_test.BIN": {"refused cut off", "lacks rpm", "lacks distance"},
    "logs/sample_log_small.ulg": {"lacks rpm", "doubt dropouts"},
    "logs/sample_px4_events.ulg": {"lacks distance", "doubt dead channel"},
    "logs/uavlogviewer_vtol.tlog": {"lacks rpm", "repaired time starts anew"},
    "uiuc/apcff_4.2x4_static_0615rd.txt": {"doubt air density", "repaired line ends"},
}  # fmt: skip
"""Expected findings; other files must import, too."""

NO_MEASUREMENTS = {"rcbenchmark_1520/NAME_RULE.csv", "SOURCES.md", "pitch_bench/bench.json"}


def read_one(path: Path, folder: Path) -> ImportResult:
    if path.name != "rotor_pairs.csv":
        return import_file(path)
    (folder / "map.toml").write_text(ROTOR_PAIRS)
    return import_file(path, ImportOptions(columns=folder / "map.toml"))


def test_every_file_imports_and_nothing_is_lost(reference_data, tmp_path):
    files = {
        path.relative_to(reference_data).as_posix(): path
        for path in sorted(reference_data.rglob("*"))
        if path.is_file()
    }
    measured = {name: path for name, path in files.items() if name not in NO_MEASUREMENTS}
    assert set(EXPECTED) <= set(measured)
    table = []
    for name, path in measured.items():
        read = read_one(path, tmp_path)
        assert read.tally.is_balanced, name
        if read.tally.unit == "row":
            data_lines = [line for line in path.read_bytes().split(b"\n")[1:] if line.strip(b"\r")]
            assert read.tally.total == len(data_lines), name
            assert read.tally.refused == 0, name
        stated = {f"{item.kind} {item.what}" for item in read.findings}
        assert EXPECTED.get(name, set()) <= stated, (name, stated)
        finite = np.isfinite(read.recording.values).any(axis=0)
        assert finite.all(), name
        listed = ", ".join(sorted(stated)) or "nothing"
        table.append(f"{name} | {read.tally.kept} of {read.tally.total} | {listed}")
    print("\n".join(table))  # shown with -s
    assert len(table) == len(measured)


def test_a_crazyflie_gives_the_known_coefficient(reference_data):
    recording = import_file(reference_data / "crazyflie" / "cf2.1-stock-prop.csv").recording
    squared = np.sum([recording.column(f"rpm{n}") ** 2 for n in (1, 2, 3, 4)], axis=0)
    weight_gf = recording.column("thrust_N") / 9.80665e-3
    slope = float(squared @ weight_gf / (squared @ squared))
    assert slope == pytest.approx(2.26e-8, rel=0.02)  # kf of SOURCES.md
