"""Runs set side by side: interpolation at a thrust against laws known exactly, ranks, refusals."""

from __future__ import annotations

from math import hypot
from pathlib import Path

import numpy as np
import pytest

from benchtool.core.channel import Channel, error_channel_name, unit_from_name
from benchtool.core.errors import FileFormatError, InputError, UnknownChoice
from benchtool.core.recording import Recording
from benchtool.data.derived import derive_quantities, measurement_context
from benchtool.data.levels import split_levels
from benchtool.data.run.recording_file import write_recording
from benchtool.report.compare.page import best_table, compare_runs, comparison_sentence
from benchtool.report.compare.runs import ComparedRun, at_thrust, read_compared

GF = 9.80665e-3
ROOT = Path(__file__).parents[3]


def table(**columns: object) -> Recording:
    """Return a recording of these columns."""
    return Recording.from_columns(
        [(Channel(name, unit_from_name(name)), np.asarray(v, float)) for name, v in columns.items()]
    )


def stand(factor: float, thrust_N: object, *, noise: float = 0.0, seed: int = 0) -> Recording:
    """Return levels of a stand that draws factor T^1.5 watts."""
    thrust = np.asarray(thrust_N, float)
    scatter = 1.0 + noise * np.random.default_rng(seed).standard_normal(len(thrust))
    return table(
        thrust_N=thrust, voltage_V=np.full(len(thrust), 10.0),
        current_A=factor * thrust**1.5 / 10.0 * scatter, rpm1=1000.0 * np.sqrt(thrust),
        pwm1_us=1000.0 + 100.0 * thrust,
    )  # fmt: skip


def written(folder: Path, name: str, recording: Recording) -> Path:
    """Write a recording as `benchtool import` does, and return its path."""
    path = folder / f"{name}.csv"
    write_recording(path, recording, {})
    return path


@pytest.mark.parametrize("levels", [(2.0, 4.0, 6.0, 8.0), tuple(np.linspace(0.5, 9.0, 30))])
def test_a_power_law_is_interpolated_exactly(tmp_path, levels):
    run = read_compared(written(tmp_path, "one", stand(6.0, levels)))
    got = at_thrust(run, 5.0).values
    assert got["power_W"][0] == pytest.approx(6.0 * 5.0**1.5)
    assert got["rpm1"][0] == pytest.approx(1000.0 * 5.0**0.5)
    assert got["efficiency_gf_W"][0] == pytest.approx(5.0 / GF / (6.0 * 5.0**1.5))


def test_the_error_is_what_the_scatter_makes_over_fixed_seeds(tmp_path):
    levels, off, stated = np.linspace(0.5, 9.0, 30), [], []
    for seed in range(60):
        recording = stand(6.0, levels, noise=0.02, seed=seed)
        quantities = derive_quantities(recording, measurement_context())
        run = ComparedRun(name="one", path=tmp_path, rows=recording, quantities=quantities)
        value, sd = at_thrust(run, 5.0).values["power_W"]
        off.append(value / (6.0 * 5.0**1.5) - 1.0)
        stated.append(sd / value)
    assert np.std(off) == pytest.approx(np.mean(stated), rel=0.25)
    assert np.mean(np.abs(off) < 2.0 * np.array(stated)) > 0.88


def test_stated_errors_of_thrust_and_power_pass_into_the_efficiency(tmp_path):
    levels = (4.0, 5.0, 6.25)  # the middle one is at the thrust, so that weights are those of 1/3
    recording = stand(6.0, levels)
    for name, share in (("thrust_N", 0.01), ("current_A", 0.02), ("voltage_V", 0.0)):
        own = share * recording.column(name) + 1e-12
        recording = recording.with_column(
            Channel(error_channel_name(name), unit_from_name(name)), own
        )
    run = read_compared(written(tmp_path, "one", recording))
    value, sd = at_thrust(run, 5.0).values["efficiency_gf_W"]
    # Three rows, symmetric in the logarithm: the mean of ln P - 1.5 ln T.
    assert sd / value == pytest.approx(hypot(0.02, 1.5 * 0.01) / 3.0**0.5, rel=1e-3)


def test_runs_are_ranked_and_those_that_do_not_reach_the_thrust_are_named(tmp_path):
    levels = np.linspace(0.5, 9.0, 30)
    paths = [
        written(tmp_path, name, stand(factor, shown, noise=0.005, seed=place))
        for place, (name, factor, shown) in enumerate(
            [("thirsty", 7.0, levels), ("frugal", 6.0, levels), ("small", 5.0, levels / 3.0)]
        )
    ]
    one = compare_runs(paths, thrust_N=5.0)
    assert [found.run for found in one.found] == ["frugal", "thirsty", "small"]
    assert one.found[2].remark == "reaches 0.167 to 3 N"
    assert comparison_sentence(one).endswith("All reach 2.97 N: --at-thrust 2.97.")
    table = best_table(one)
    assert table is not None
    assert [row[0] for row in table.rows] == ["1", "2", "–"]
    assert float(table.rows[1][-2]) > 10.0


def test_what_cannot_be_compared_is_refused_with_the_axes_that_can(tmp_path):
    path = written(tmp_path, "one", stand(6.0, (1.0, 2.0)))
    with pytest.raises(InputError, match="use --over thrust or rpm or power or throttle"):
        compare_runs([path], "distance")
    with pytest.raises(UnknownChoice, match="volts"):
        compare_runs([path], "volts")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="no input"):
        compare_runs([])
    with pytest.raises(FileFormatError, match="there is no such file or run folder"):
        compare_runs([tmp_path / "nothing"])
    bare = written(tmp_path, "bare", table(rpm1=[1.0, 2.0]))
    with pytest.raises(FileFormatError, match="thrust is missing"):
        compare_runs([bare])


def test_levels_are_the_steady_half_of_each_step_with_errors_of_their_means():
    pulse = np.repeat([1100.0, 1300.0, 1100.0], 8)
    thrust = np.tile([9.0, 9.0, 9.0, 9.0, 1.0, 2.0, 3.0, 4.0], 3)
    thrust[12:16] += 10.0
    found = split_levels(table(time_s=np.arange(24.0), pwm1_us=pulse, thrust_N=thrust))
    assert found.column("pwm1_us").tolist() == [1100.0, 1300.0, 1100.0]
    assert found.column("thrust_N").tolist() == [2.5, 12.5, 2.5]
    assert found.column("thrust_se_N") == pytest.approx(np.sqrt(5.0 / 3.0 / 4.0))


def test_a_ramp_that_moves_all_the_time_is_cut_into_means_of_half_a_second():
    time = np.arange(0.0, 4.0, 0.01)
    pulse = 1100.0 + 50.0 * np.floor(time / 0.05)
    found = split_levels(table(time_s=time, pwm1_us=pulse, thrust_N=pulse / 1000.0))
    assert len(found) == 8
    assert found.column("thrust_N") == pytest.approx(found.column("pwm1_us") / 1000.0)


def test_a_sweep_is_what_it_is_away_from_the_plate_but_over_distance():
    run = ROOT / "datasets" / "quad" / "run"
    away, near = read_compared(run), read_compared(run, "distance")
    assert away.away
    assert not near.away
    assert away.rows.column("plate_z_m").min() > near.rows.column("plate_z_m").max()
    assert len(away.quantities[0].value) == len(away.rows)
