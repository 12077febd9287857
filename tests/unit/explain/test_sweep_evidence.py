"""Plate sweeps as evidence: their logs, rotor speeds and residuals, white at the truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchtool.core.channel import Channel
from benchtool.core.errors import InputError
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.core.rig_file import load_rig_by_name
from benchtool.data.columns import KINDS, find_channel
from benchtool.data.run.read import read_points
from benchtool.explain.engine.evidence import parameters_at
from benchtool.explain.sweep.evidence import SweepEvidence
from benchtool.explain.sweep.log import SupplyModel, sweep_log
from benchtool.explain.sweep.next_experiment import predict_readings, speed_at
from benchtool.fit.uncertainty.bench_errors import bench_errors
from benchtool.physics.model_file import load_model
from benchtool.simulate.imperfections import Imperfections
from benchtool.simulate.plate_bench import PlateBench
from tests.unit.physics.blades import bladed

QUAD = Path(__file__).parents[3] / "datasets" / "quad" / "run"


@pytest.fixture(scope="module")
def evidence():
    model = load_model("quad").model
    return SweepEvidence(model, [sweep_log(read_points(QUAD, KINDS), model.rig)])


def parameter(evidence: SweepEvidence, name: str) -> int:
    """Return the place of a parameter."""
    return [item.name for item in evidence.parameters].index(name)


def drawn(evidence: SweepEvidence, at: np.ndarray, seed: int) -> SweepEvidence:
    """Return evidence of a bench with those parameters, its noise drawn as stated."""
    rng = np.random.default_rng(seed)
    swept = evidence.logs[0]
    assert swept.power is not None
    at_pulses = speed_at(swept.power.pulse_us, evidence.model.rig)
    power = swept.power.planned(swept.power.time_s, swept.power.pulse_us, at_pulses)
    log = predict_readings(replace(swept, power=power), evidence, at)
    noise = evidence.noise_roots[0] @ rng.standard_normal(len(log))
    assert log.power is not None
    power = replace(
        log.power,
        speed_rad_s=log.power.speed_rad_s
        + log.power.speed_se * rng.standard_normal(len(log.power.speed_se)),
        voltage_V=log.power.voltage_V
        + log.power.voltage_se * rng.standard_normal(len(log.power.voltage_V)),
    )
    return evidence.of(replace(log, thrust_N=log.thrust_N + noise, power=power))


def test_predictions_are_those_of_the_model(evidence):
    scaled = np.zeros(len(evidence.parameters))
    scaled[parameter(evidence, "body_lift.K_b")] = 8.0
    scaled[parameter(evidence, "plate_offset.dz_m")] = 1.0
    model = evidence.model.with_values(
        parameters_at(evidence.model.parameters, evidence.parameters, scaled)
    )
    assert model.parameters["body_lift.K_b"].value == pytest.approx(2.0)
    expected = model.thrust_N(evidence.logs[0].conditions)
    found = evidence.thrusts(evidence.logs[0].conditions, scaled[None, :])[:, 0]
    assert found == pytest.approx(expected, rel=1e-12)


def test_residuals_are_white_at_the_truth(evidence):
    scaled = np.zeros(len(evidence.parameters))
    scaled[parameter(evidence, "body_lift.K_b")] = 8.0
    squares = [np.mean(drawn(evidence, scaled, seed).residuals(scaled) ** 2) for seed in range(20)]
    # Each level's own speed and the voltage at the start are fitted, so a little below 1.
    assert 0.9 < np.mean(squares) < 1.03


def test_battery_sag_shows_in_speeds_and_voltage_alone(evidence):
    sets = np.zeros((2, len(evidence.parameters)))
    sets[1, parameter(evidence, "battery_sag.rate_per_s")] = 1.0
    rows = evidence.residuals(sets)
    changed = np.abs(rows[:, 1] - rows[:, 0]) > 1e-9
    stages = evidence.groups().stages
    assert not changed[stages["rpm_to_thrust"]].any()
    assert changed[stages["pwm_to_rpm"]].mean() > 0.9


def test_the_noise_is_that_of_a_fit(evidence):
    log = evidence.logs[0]
    covariance = np.diag(log.se_N**2)
    for source in bench_errors(evidence.model, log.conditions, log.visits):
        covariance += source.columns @ source.columns.T
    root = evidence.noise_roots[0]
    np.testing.assert_allclose(root @ root.T, covariance, rtol=1e-9, atol=1e-15)


def swept_at_one_pulse(rig: Rig) -> Recording:
    """Return settled visits of a virtual bench without a flaw, near and far in turn."""
    truth = load_model("single", rig).model
    bench = PlateBench(rig, truth, np.random.default_rng(1), Imperfections.none())
    bench.command_pwm(np.array([1500.0]))
    names = [channel.name for channel in bench.channels]
    rows = []
    for z_over_R in (0.5, 8.0, 0.7, 1.0, 8.0, 0.5, 2.0, 0.7):
        bench.command_plate(z_over_R * rig.propulsion.radius_m)
        while bench.plate_moving:
            bench.advance(200)
        rows.append([bench.time_s, *np.nanmedian(bench.advance(800)[-200:], axis=0)])
    channels = (Channel("time_s", "s", ""), *bench.channels)
    wanted = ["time_s", *(n for n in names if n.startswith(("pwm", "rpm", "thrust_N", "plate_")))]
    places = {channel.name: place for place, channel in enumerate(channels)}
    columns = [(channels[places[n]], np.array(rows)[:, places[n]]) for n in wanted]
    return Recording.from_columns(columns, {}, True)


def test_blades_and_motor_predict_the_speed_at_a_pulse_against_the_plate():
    """It rises by 0.5 % at z/R 0.5; a model that leaves blades out misses that."""
    rig = bladed("pquad_single")
    points = swept_at_one_pulse(rig)
    missed = {}
    for share in (1.0, 0.0):
        model = load_model("single", rig).model.with_fixed("blade_inflow.share", share)
        evidence = SweepEvidence(model, [sweep_log(points, rig)])
        scaled = np.zeros((1, len(evidence.parameters)))
        for name in ("supply.drop", "battery_sag.rate_per_s"):
            item = evidence.parameters[parameter(evidence, name)]
            scaled[0, parameter(evidence, name)] = -item.start / item.scale
        power = evidence.logs[0].power
        assert power is not None
        late = power.is_predicted
        read = power.rotor_rad_s[:, :, None]
        shown = evidence.predicted(evidence.logs[0], scaled, read)[0, late, 0]
        missed[share] = np.abs(shown / power.speed_rad_s[late] - 1.0)
    assert missed[1.0].max() < 1e-9
    assert 0.002 < missed[0.0].max() < 0.006


RIG = load_rig_by_name("pquad")


@pytest.fixture(scope="module")
def points():
    return read_points(QUAD, KINDS)


def only(recording: Recording, *names: str) -> Recording:
    """Return the recording with only those columns."""
    return Recording.from_columns([(find_channel(name), recording.column(name)) for name in names])


def test_rows_with_empty_cells_are_left_out_and_counted(points):
    values = points.values.copy()
    values[5, points.index("thrust_N")] = np.nan
    log = sweep_log(Recording(points.channels, values), RIG)
    assert len(log) == len(points) - 1
    assert any(f"missing values: 1 of {len(points)} rows" in remark for remark in log.remarks)


def test_points_without_thrust_are_refused(points):
    with pytest.raises(InputError, match=r"few\.csv has no thrust_N, only plate_z_m, rpm1"):
        sweep_log(only(points, "plate_z_m", "rpm1"), RIG, "few.csv")


def test_too_few_points_are_refused(points):
    with pytest.raises(InputError, match=r"has 3 complete points .*; minimum: 4"):
        sweep_log(points.select(np.arange(1, 4)), RIG, "few.csv")


@pytest.fixture(scope="module")
def power():
    found = sweep_log(read_points(QUAD, KINDS), load_model("quad").model.rig).power
    assert found is not None
    return found


def sagging(power: SupplyModel) -> np.ndarray:
    """Return what a supply keeps that sags steadily (m, 1)."""
    return power.supply(np.array([1e-4]), np.array([0.0]), np.array([0.02]))


def test_speeds_of_a_supply_that_is_known_are_predicted_exactly(power):
    drive = sagging(power)[None]
    scale = 1.0 + power.level
    read = np.broadcast_to(scale * drive[0, :, 0], power.rotor_rad_s.shape)[:, :, None]
    predicted = power.predicted(drive, read)
    assert predicted[:, power.is_predicted] == pytest.approx(read[:, power.is_predicted], rel=1e-12)
    assert not predicted[:, ~power.is_predicted].any()


def test_only_earlier_visits_predict(power):
    drive = sagging(power)[None]
    read = power.rotor_rad_s[:, :, None].copy()
    before = power.predicted(drive, read)
    place = int(np.flatnonzero(power.is_predicted)[len(power.is_predicted) // 2])
    read[:, place] *= 1.5
    after = power.predicted(drive, read)
    changed = np.flatnonzero((before != after).any(axis=(0, 2)))
    assert len(changed) > 1
    assert changed.min() > place
    assert (power.level[changed] == power.level[place]).all()


def test_load_is_counted_as_in_the_other_sweep(power):
    harder = replace(power, full_load=1.25 * power.full_load)
    same = power.loaded_as(harder)
    assert same.load == pytest.approx(power.load / 1.25)
    assert same.load * same.full_load == pytest.approx(power.load * power.full_load)
