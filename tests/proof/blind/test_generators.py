"""What both generators of blind records promise: determinism, sizes, dirt, independence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("mujoco", reason="the blind pitch bench is a MuJoCo model")

from tests.proof.blind.families import RANGES, packages_imported
from tests.proof.blind.pitch import dirt as pitch_dirt
from tests.proof.blind.pitch import library as pitch_library
from tests.proof.blind.pitch import records as pitch
from tests.proof.blind.pitch import seeds
from tests.proof.blind.sweep import dirt as sweep_dirt
from tests.proof.blind.sweep import library as sweep_library
from tests.proof.blind.sweep import records as sweep
from tests.proof.blind.sweep.layouts import LAYOUTS

HERE = Path(__file__).parent
EACH_BENCH = pytest.mark.parametrize("bench", [pitch, sweep], ids=["pitch", "sweep"])
EACH_LAYOUT = pytest.mark.parametrize("layout", [None, *LAYOUTS.values()], ids=str)
"""None is the pitch bench, which has one."""


@EACH_BENCH
def test_the_same_arguments_make_the_same_record(bench):
    one, again, other = (bench.make_record(seed, "none", excitation="rich") for seed in (0, 0, 3))
    pd.testing.assert_frame_equal(one.learn, again.learn)
    pd.testing.assert_frame_equal(one.check, again.check)
    assert one.truth == again.truth
    assert other.truth != one.truth
    if bench is pitch:
        assert other.truth.plant != one.truth.plant
        assert not one.learn["theta_ref"].equals(one.check["theta_ref"])
    else:
        assert other.truth.bench != one.truth.bench
        assert one.model_toml == again.model_toml


@EACH_BENCH
def test_a_pair_can_be_asked_for_by_name(bench):
    names = ("cog_offset", "motor_lag") if bench is pitch else ("plate_offset", "body_lift")
    record = bench.make_record(5, "+".join(names), excitation="rich")
    assert record.truth.names == names
    assert len(bench.pairs()) == (14 * 13 // 2 if bench is pitch else 11 * 10 // 2)
    with pytest.raises(ValueError, match="there is no family"):
        bench.make_record(5, "+".join([names[0]] * 2), excitation="rich")
    if bench is sweep:
        assert record.truth.layout == "quad"
        with pytest.raises(ValueError, match="cannot show on layout 'single'"):
            sweep.make_record(5, "body_lift", excitation="rich", layout="single")


@EACH_LAYOUT
def test_sizes_cover_their_ranges_on_both_sides(layout, rng):
    named = pitch_library.NAMED if layout is None else sweep_library.NAMED
    on = [] if layout is None else [layout]
    for effect in named.values():
        for strength, (low, high) in RANGES.items():
            sizes = np.array([effect.hide(rng, *on, strength).size for _ in range(200)])
            assert low <= np.abs(sizes).min()
            assert np.abs(sizes).max() <= high
            assert (sizes < 0).any() == (effect.most_below > 0)
            assert (sizes > 0).any() == (effect.most_above > 0)


@EACH_LAYOUT
def test_a_dirty_bench_stays_within_half_of_every_tolerance(layout, rng):
    for _ in range(100):
        if layout is None:
            plant = pitch_dirt.dirty_bench(rng)
            off = {
                name: (getattr(plant, effect.field) - effect.neutral) / effect.tolerance
                for name, effect in pitch_library.NAMED.items()
            }
            assert len(plant.departures()) >= 20
        else:
            bench = sweep_dirt.dirty_bench(rng, layout)
            # Neighbours are there; five tolerances of them are what the sheet says.
            off = {
                name: effect.value_in(bench) - (5.0 if name == "neighbour_images" else 0.0)
                for name, effect in sweep_library.NAMED.items()
                if layout.name in effect.layouts
            }
            assert len(bench.departures()) >= 15
        assert {name: size for name, size in off.items() if abs(size) > 0.5 + 1e-6} == {}


def test_scoring_seeds_are_kept_apart(monkeypatch):
    assert not set(seeds.DEVELOPMENT_SEEDS) & set(seeds.SCORING_SEEDS)
    monkeypatch.delenv(seeds.SCORING_SWITCH, raising=False)
    with pytest.raises(PermissionError, match="run `make blind`"):
        seeds.checked(seeds.SCORING_SEEDS.start)
    monkeypatch.setenv(seeds.SCORING_SWITCH, "1")
    assert seeds.checked(seeds.SCORING_SEEDS.start) == 1_000_000
    with pytest.raises(ValueError, match="neither for development"):
        seeds.checked(500_000)


@pytest.mark.parametrize(("bench", "uses_mujoco"), [("pitch", True), ("sweep", False)])
def test_nothing_of_benchtool_is_imported(bench, uses_mujoco):
    imported = packages_imported(HERE / bench)
    assert "numpy" in imported
    assert "benchtool" not in imported
    assert ("mujoco" in imported) == uses_mujoco
