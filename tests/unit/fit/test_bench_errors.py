"""Errors of place, of scales and of the zero: what they do to thrusts, and to a fit of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchtool.core.channel import Channel
from benchtool.core.errors import InputError
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.core.rig_file import load_rig_by_name
from benchtool.core.units import Array
from benchtool.data.calibration import ZeroNoise, zero_covariance
from benchtool.data.columns import word_to_code
from benchtool.fit.ensemble import fit_ensemble
from benchtool.fit.least_squares import fit_least_squares
from benchtool.fit.model_problem import problem_from_model
from benchtool.fit.problem import Problem
from benchtool.fit.uncertainty.bench_errors import Visits, bench_errors, concatenate_visits
from benchtool.fit.uncertainty.load_cell import estimate_zero_drift, standstill_means
from benchtool.physics.conditions import Conditions
from benchtool.physics.model import Model

RADIUS_M = 0.12
NEAR = np.array([0.6, 0.8, 1.0, 1.5, 2.0, 3.0, 8.0])


def rig(**more: Any) -> Rig:
    """Return the quadrotor's rig without errors of its own, some stated."""
    plain = load_rig_by_name("pquad")
    plate = replace(plain.plate, backlash_m=0.0, repeatability_m=more.pop("repeatability_m", 0.0))
    body = replace(plain.body, arm_sd=more.pop("arm_sd", 0.0))
    sensors = {name: replace(one, quantum=0.0, walk=0.0) for name, one in plain.sensors.items()}
    for name, changes in more.items():
        sensors[name] = replace(sensors[name], **changes)
    return replace(plain, plate=plate, body=body, sensors=sensors)


def model(on: Rig) -> Model:
    lifted = Model.single(on).with_effect("neighbour_images").with_effect("body_lift", K_b=1.7)
    return lifted.with_free("k", "R_m", "body_lift.K_b")


def sweep(on: Rig, repeats: int = 3) -> tuple[Conditions, Visits]:
    """Return conditions of two levels at every distance, again and again, ten seconds apart."""
    z_m = RADIUS_M * np.tile(np.repeat(NEAR, 2), repeats)
    speed = np.tile([420.0, 560.0], len(NEAR) * repeats)
    time = 10.0 * np.arange(1.0, len(z_m) + 1.0)
    conditions = Conditions.build(
        on, speed_rad_s=np.tile(speed, (4, 1)), plate_z_m=z_m, time_s=time, elapsed_s=time
    )
    n = len(z_m)
    visits = Visits(
        stay=np.repeat(np.arange(n // 2), 2),
        zero_s=time,
        tared=np.zeros(n, np.intp),
        tare=np.zeros(n, bool),
        rounded=np.ones(n, bool),
        one_sided=False,
        calibrated=False,
        zero=ZeroNoise(on.sensors["thrust_N"].walk),
    )
    return conditions, visits


def sources(on: Rig) -> dict[str, Array]:
    found = bench_errors(model(on), *sweep(on))
    return {source.name: source.columns for source in found}


def test_a_place_is_shared_by_the_points_of_a_stay():
    (columns,) = sources(rig(repeatability_m=1e-4)).values()
    on = rig()
    conditions, visits = sweep(on)
    slope = model(on).thrust_N(conditions.with_plate_offset(1e-4)) - model(on).thrust_N(conditions)
    covariance = columns @ columns.T
    together = visits.stay[:, None] == visits.stay
    np.testing.assert_allclose(covariance, np.where(together, np.outer(slope, slope), 0.0))


def test_a_reading_is_wrong_by_the_same_whenever_it_is_read():
    columns = sources(rig(plate_z_m={"quantum": 1e-3}))["plate reading"]
    assert columns.shape[1] == len(NEAR)
    assert columns[0, 0] == columns[2 * len(NEAR), 0] != 0.0


def test_a_distance_on_the_grid_of_its_sensor_is_read_without_error():
    on = rig(plate_z_m={"quantum": 1e-4})
    stage_m = np.array([0.072, 0.07604, 0.12, np.nan])
    points = Recording.from_columns(
        [
            *((Channel(f"rpm{rotor}", "rpm"), np.full(4, 5000.0)) for rotor in range(1, 5)),
            (Channel("time_s", "s"), np.arange(4.0)),
            (Channel("plate_z_m", "m"), np.array([0.072, 0.076, 0.12, 0.18])),
            (Channel("plate_stage_z_m", "m"), stage_m),
            (Channel("plate_read_z_m", "m"), 1e-4 * np.array([720, 760, 1200, 1800])),
        ]
    )
    conditions = Conditions.from_recording(points, on)
    visits = Visits.of(points, conditions, on)
    assert visits.rounded.tolist() == [False, True, False, True]
    (reading,) = bench_errors(model(on), conditions, visits)
    assert (reading.name, reading.columns.shape) == ("plate reading", (4, 2))
    assert np.flatnonzero(np.abs(reading.columns).sum(axis=1)).tolist() == [1, 3]
    exact = points.select(np.array([0, 2]))
    conditions = Conditions.from_recording(exact, on)
    assert bench_errors(model(on), conditions, Visits.of(exact, conditions, on)) == ()


def test_scales_move_all_points_together():
    on = rig(
        arm_sd=0.01,
        plate_z_m={"scale_sd": 0.01},
        rpm={"scale_sd": 0.002},
        thrust_N={"scale_sd": 0.005},
    )
    found = sources(on)
    thrust = model(on).thrust_N(sweep(on)[0])
    np.testing.assert_allclose(found["rpm scale"][:, 0], thrust * (1.002**2 - 1.0), rtol=1e-9)
    np.testing.assert_allclose(found["thrust scale"][:, 0], 0.005 * thrust, rtol=1e-9)
    assert (found["distance scale"][:4] < 0.0).all()  # farther away, less thrust
    assert (np.abs(found["arm"][:4]) > 1e-4).all()
    # What a calibration states is not counted again.
    conditions, visits = sweep(on)
    calibrated = bench_errors(model(on), conditions, replace(visits, calibrated=True))
    assert "thrust scale" not in {source.name for source in calibrated}


def test_a_zero_wanders_from_its_tare_on():
    since = np.array([0.0, 1.0, 4.0, 100.0])
    walk = zero_covariance(since, ZeroNoise(2e-4))
    np.testing.assert_allclose(walk, 4e-8 * np.minimum(since[:, None], since))
    both = zero_covariance(since, ZeroNoise(2e-4, 1e-3))
    assert both[0, 0] == 0.0  # it was known at the tare
    assert np.linalg.eigvalsh(both)[0] > -1e-12
    # 1/f noise: each decade of time adds the same variance, twice that of one process.
    decades = np.diff(np.diag(both - walk)[[1, 3]]) / 2.0
    assert decades == pytest.approx(2e-6, rel=0.1)


def test_points_of_two_tares_do_not_wander_together():
    on = rig(thrust_N={"walk": 2e-4})
    conditions, visits = sweep(on)
    two = concatenate_visits([visits, visits])
    assert two.stay.max() == 2 * visits.stay.max() + 1
    twice = Conditions.build(
        on,
        speed_rad_s=np.tile(conditions.speed_rad_s, 2),
        plate_z_m=np.tile(conditions.plate_z_m, 2),
    )
    (wander,) = bench_errors(model(on), twice, two)
    n = len(conditions)
    covariance = wander.columns @ wander.columns.T
    assert np.all(covariance[:n, n:] == 0.0)
    exact = zero_covariance(visits.zero_s, visits.zero)
    largest = float(exact.max())
    np.testing.assert_allclose(covariance[:n, :n], exact, atol=0.03 * largest)
    assert (wander.kind, wander.unit) == ("B", "N")


def drawn(on: Rig, seed: int, *, free_place: bool = False) -> Problem:
    """Return a fit of a sweep whose errors are drawn from the sources of the rig."""
    rng = np.random.default_rng(seed)
    truth, (conditions, visits) = model(on), sweep(on)
    errors = bench_errors(truth, conditions, visits)
    thrust = truth.thrust_N(conditions) + 0.004 * rng.standard_normal(len(conditions))
    for source in errors:
        thrust = thrust + source.columns @ rng.standard_normal(source.columns.shape[1])
    fitted = truth.with_free("noise.place_m") if free_place else truth
    return problem_from_model(
        fitted, conditions, thrust, np.full(len(thrust), 0.004), error_sources=errors
    )


PLACED = rig(repeatability_m=3e-4, thrust_N={"walk": 2e-4})


def test_the_scatter_of_places_can_be_estimated():
    found, inside = [], 0
    for seed in range(100, 116):
        problem = drawn(PLACED, seed, free_place=True)
        result = fit_least_squares(problem)
        found.append(result["noise.place_m"].value)
        low, high = result["noise.place_m"].interval_95
        inside += low < 3e-4 < high
    error = np.std(found, ddof=1) / 4.0
    assert np.mean(found) == pytest.approx(3e-4, abs=3.0 * error)
    assert error < 3e-5
    assert inside >= 12  # 95 % of 16, chance of fewer 1 in 1000
    posterior = fit_ensemble(problem)
    for name in ("noise.place_m", "body_lift.K_b"):
        assert posterior[name].value == pytest.approx(result[name].value, abs=result[name].sd)
        assert posterior[name].sd == pytest.approx(result[name].sd, rel=0.25)


def test_a_place_that_nothing_feels_cannot_be_estimated():
    on = rig(repeatability_m=1e-4)
    conditions = Conditions.build(on, speed_rad_s=np.full((4, 6), 500.0), plate_z_m=np.full(6, 1e6))
    with pytest.raises(InputError, match="no point depends on the plate position"):
        problem_from_model(
            model(on).with_free("noise.place_m"), conditions, np.full(6, 10.0), np.full(6, 0.01)
        )


def test_play_is_an_offset_where_places_are_approached_from_one_side():
    plain = load_rig_by_name("pquad")
    assert plain.position_sd_m() == pytest.approx(plain.plate.backlash_m / 12.0**0.5)
    assert plain.position_sd_m(one_sided=True) == 0.0
    stated = replace(plain, plate=replace(plain.plate, repeatability_m=5e-5))
    assert stated.position_sd_m() == stated.position_sd_m(one_sided=True) == 5e-5


def still_samples(walk: float, seed: int) -> Recording:
    """Return ten minutes of a bench that moves its plate for four seconds in every ten."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 600.0, 0.05)
    zero = 0.02 + 3e-5 * time + np.cumsum(walk * np.sqrt(0.05) * rng.standard_normal(len(time)))
    moving = time % 10.0 < 4.0
    names = ["time_s", "phase", "thrust_N", "rpm1"]
    phase = np.where(moving, word_to_code("phase", "move"), word_to_code("phase", "sample"))
    thrust = zero + 0.01 * rng.standard_normal(len(time)) + np.where(moving, 0.0, 5.0)
    columns = [time, phase, thrust, np.where(moving, 0.0, 5000.0)]
    return Recording(tuple(Channel(name, "1") for name in names), np.column_stack(columns))


def test_a_run_shows_the_walk_of_its_own_zero():
    still = [standstill_means(still_samples(5e-4, seed)) for seed in range(12)]
    assert all(60 < len(means) < 400 for means in still)
    found = [estimate_zero_drift(means, ZeroNoise()) for means in still]
    logs = np.log([one.walk / 5e-4 for one in found])
    assert abs(logs.mean()) < 0.2
    # Its degrees of freedom say how well it is known: 1 / sqrt(2 dof) of its value.
    expected = np.mean([1.0 / np.sqrt(2.0 * one.dof) for one in found])
    assert logs.std(ddof=1) == pytest.approx(expected, rel=0.6)
    # A stated walk is a prior: it pulls, and a run without still stretches leaves it as it is.
    pulled = estimate_zero_drift(still[0], ZeroNoise(5e-5))
    assert 5e-5 < pulled.walk < found[0].walk
    none = [
        estimate_zero_drift(standstill_means(still_samples(0.0, seed)), ZeroNoise())
        for seed in range(6)
    ]
    assert np.median([one.walk for one in none]) < 1e-5
