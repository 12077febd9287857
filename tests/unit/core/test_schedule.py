"""Schedules: shapes, plate visits, switches, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchtool.core.errors import FileFormatError, InputError, UnknownChoice
from benchtool.core.schedule import (
    PARKED_M,
    PlateVisit,
    Schedule,
    Signal,
    Switch,
    load_schedule,
    schedule_to_toml,
)
from benchtool.core.toml_text import read_strict
from benchtool.core.user_file import list_names

T = np.arange(0.0, 10.0, 0.01)
VISIT = PlateVisit(z_over_R=2.0, in_s=2.0, out_s=6.0, move_s=0.5)


def shape(**values: object) -> np.ndarray:
    return Signal(**values).sampled(T, 10.0)  # type: ignore[arg-type]


def test_shapes():
    step = shape(shape="step", level=2.0, from_s=1.0, to_s=3.0)
    assert step[T < 1.0 - 1e-6].max() == 0.0
    assert step[(T > 1.0 + 1e-6) & (T < 3.0 - 1e-6)].min() == 2.0
    assert step[T > 3.0 + 1e-6].max() == 0.0
    ramp = shape(shape="ramp", level=2.0, from_s=1.0, to_s=3.0)
    np.testing.assert_allclose(ramp, np.clip(T - 1.0, 0.0, 2.0), atol=1e-12)
    triangle = shape(shape="triangle", level=3.0, period_s=4.0)
    np.testing.assert_allclose(triangle[[0, 100, 200, 300]], [0.0, 3.0, 0.0, -3.0], atol=1e-9)
    levels = shape(shape="steps", levels=(1.0, -1.0, 2.0), every_s=2.0)
    np.testing.assert_array_equal(levels[[0, 199, 200, 401, 999]], [1.0, 1.0, -1.0, 2.0, 2.0])
    prbs = shape(shape="prbs", level=15.0, bit_s=0.1, seed=4)
    assert set(prbs) == {-15.0, 15.0}
    assert np.all(np.diff(prbs.reshape(-1, 10), axis=1) == 0.0)


def test_the_plate_comes_and_goes():
    schedule = Schedule(name="x", title="x", duration_s=10.0, plate=(VISIT,)).sampled(100.0, 0.12)
    at = {round(t, 2): k for k, t in enumerate(schedule.time_s)}
    assert schedule.plate_share[at[2.25]] == pytest.approx(0.5)
    assert schedule.plate_share[at[4.0]] == 1.0
    assert schedule.plate_share[at[6.25]] == pytest.approx(0.5)
    assert schedule.plate_z_m[at[4.0]] == pytest.approx(0.24)
    assert schedule.plate_z_m[at[1.0]] == schedule.plate_z_m[at[7.0]] == PARKED_M
    at_once = PlateVisit(z_over_R=2.0, in_s=0.0, out_s=5.0, move_s=0.0)
    np.testing.assert_array_equal(at_once.share(np.array([0.0, 4.99, 5.0])), [1.0, 1.0, 0.0])


def test_switches_act_from_their_time_on():
    schedule = Schedule(
        name="x",
        title="x",
        duration_s=4.0,
        switches=(Switch(at_s=0.0, observer=False), Switch(at_s=2.0, observer=True)),
    ).sampled(10.0, 0.12)
    np.testing.assert_array_equal(schedule.observer, np.repeat([0.0, 1.0], 20))
    assert np.all(schedule.feedforward == 1.0)


def test_bad_schedules_are_refused(tmp_path):
    early = PlateVisit(z_over_R=2.0, in_s=2.0, out_s=2.2)
    with pytest.raises(InputError, match=r"moves out at 2\.2 s, before it has moved in at 2\.5 s"):
        Schedule(name="x", title="x", duration_s=10.0, plate=(early,))
    with pytest.raises(InputError, match="not in order of time"):
        Schedule(name="x", title="x", duration_s=1.0, switches=(Switch(at_s=1), Switch(at_s=0)))
    with pytest.raises(InputError, match="duration_s is nan"):
        load_schedule("plate").with_duration(float("nan"))
    with pytest.raises(InputError, match=r"from_s 1\.5 and to_s 1"):
        Signal(shape="step", from_s=1.5, to_s=1.0)
    path = tmp_path / "own.toml"
    path.write_text('name = "own"\ntitle = "own"\nduration_s = -1.0\n', encoding="utf-8")
    with pytest.raises(FileFormatError, match="duration_s"):
        load_schedule(path)
    with pytest.raises(UnknownChoice, match=r"known: .*plate"):
        load_schedule("plat")


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ({"duration_s": 1e9}, r"1e\+09; give at most 3600"),
        ({"reference_deg": (Signal(shape="step", level=1e9),)}, r"reference_deg .* 1e\+09"),
        ({"collective": (Signal(shape="step", level=-5.0),)}, "collective .* -4; allowed: 0 to"),
        ({"plate": (VISIT, replace(VISIT, in_s=5.0, out_s=9.0))}, "moves in at 5 s"),
    ],
)
def test_what_no_bench_follows_is_refused(parts, said):
    given = {"name": "x", "title": "x", "duration_s": 9.0, **parts}
    with pytest.raises(InputError, match=said):
        Schedule(**given).sampled(100.0, 0.12)


def test_a_chirp_ends_at_its_last_frequency():
    chirp = shape(shape="chirp", level=1.0, start_Hz=0.5, end_Hz=2.0)
    rising = T[1:][(chirp[:-1] < 0.0) & (chirp[1:] >= 0.0)]
    assert 1.0 / np.diff(rising)[-1] == pytest.approx(2.0, rel=0.05)
    assert 1.0 / np.diff(rising)[0] < 1.0


@pytest.mark.parametrize("name", list_names("schedules"))
def test_every_shipped_schedule_comes_back(name):
    schedule = load_schedule(name)
    assert read_strict(Schedule, schedule_to_toml(schedule), name) == schedule
