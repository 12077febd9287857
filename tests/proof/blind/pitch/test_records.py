"""Records of the blind pitch bench: format, families, sizes, determinism."""

from __future__ import annotations

import json
import math

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("mujoco", reason="the blind bench is a MuJoCo model")

from tests.proof.blind.pitch.library import NAMED
from tests.proof.blind.pitch.records import (
    families,
    make_record,
    write_record,
)
from tests.proof.blind.pitch.sheet import PARKED_M, PULSE_LIMITS_US, SHEET

COLUMNS = ["t", "theta_ref", "theta", "gyro", "pwm1", "pwm2", "rpm1", "rpm2", "plate_z"]


@pytest.fixture(scope="module")
def null():
    return make_record(0, "none", excitation="rich")


def check_table(table: pd.DataFrame) -> None:
    """Assert what holds for each part of each record."""
    assert list(table) == COLUMNS
    assert np.isfinite(table.to_numpy()).all()
    assert np.allclose(table["t"], np.arange(len(table)) * SHEET.dt)
    for name, quantum in (("theta", SHEET.q_theta), ("gyro", SHEET.q_gyro), ("rpm1", SHEET.q_rpm)):
        counts = table[name].to_numpy() / quantum
        assert np.abs(counts - np.round(counts)).max() < 1e-6
    pulses = table[["pwm1", "pwm2"]]
    assert (pulses.dtypes == np.int64).all()
    assert pulses.min().min() >= PULSE_LIMITS_US[0]
    assert pulses.max().max() <= PULSE_LIMITS_US[1]
    assert table["theta"].abs().max() < math.radians(45.0)
    assert (table["plate_z"] <= PARKED_M).all()


def test_a_record_reads_back_from_its_files(null, tmp_path):
    learn, check = write_record(null, tmp_path, "none")
    assert (learn.name, check.name) == ("none.csv", "none_check.csv")
    for path, table in ((learn, null.learn), (check, null.check)):
        pd.testing.assert_frame_equal(
            pd.read_csv(path), table, check_dtype=False, rtol=1e-6, atol=1e-9
        )
        assert len(table) == 7500
    assert json.loads((tmp_path / "bench.json").read_text("utf-8")) == null.bench
    assert not list(tmp_path.glob("*truth*"))


def test_the_format_is_that_of_the_reference_bench(null, reference_data, tmp_path):
    folder = reference_data / "pitch_bench"
    theirs = pd.read_csv(folder / "nothing_hidden.csv")
    ours = pd.read_csv(write_record(null, tmp_path, "none")[0])
    assert list(ours) == list(theirs)
    assert ours.dtypes.to_dict() == theirs.dtypes.to_dict()
    assert len(ours) == len(theirs)
    assert null.bench == json.loads((folder / "bench.json").read_text("utf-8"))


@pytest.mark.parametrize("family", families())
def test_every_family_runs_in_the_format(family):
    record = make_record(1, family, excitation="rich")
    for part, table in zip(record.parts, (record.learn, record.check), strict=True):
        check_table(table)
        assert part.capped == 0
    assert record.truth.kind == families()[family]
    assert len(record.truth.effects) == {"named": 1, "pair": 2}.get(record.truth.kind, 0)
    for effect in record.truth.effects:
        named = NAMED[effect.name]
        assert getattr(record.truth.plant, named.field) == effect.value
        assert 2.0 <= abs(effect.value - named.neutral) / named.tolerance <= 8.0
    assert len(record.truth.stages) == len(record.truth.names)
    json.dumps(record.truth.keys())


@pytest.mark.parametrize("family", ["none", "rotor_asymmetry", "arm_flexure", "body_lift"])
def test_poor_records_have_one_collective_one_distance_and_no_dither(family):
    record = make_record(2, family, excitation="poor", strength="weak")
    check_table(record.learn)
    mean = 0.5 * (record.learn["pwm1"] + record.learn["pwm2"])
    assert mean.nunique() == 1
    distances = record.parts[0].plate_m
    assert len(np.unique(distances[distances < PARKED_M])) == 1
    assert record.learn["theta_ref"].abs().max() <= math.radians(4.0)


def test_rich_records_step_the_collective_and_move_the_plate(null):
    mean = 0.5 * (null.learn["pwm1"] + null.learn["pwm2"]) - SHEET.pwm0
    assert mean.max() / mean.min() > 1.3
    distances = null.parts[0].plate_m
    assert len(np.unique(distances)) == 5
    assert PARKED_M in distances
    assert 0.4 < (distances == PARKED_M).mean() < 0.9


def test_a_clean_bench_is_what_its_sheet_says():
    record = make_record(6, "none", excitation="poor", dirt="clean")
    assert record.truth.imperfections == {}
