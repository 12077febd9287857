"""Subjects in which every registered figure has something to draw, by page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchtool.core.channel import Channel
from benchtool.core.recording import Recording
from benchtool.core.rig_file import load_rig_by_name
from benchtool.core.schedule import PlateVisit
from benchtool.data.columns import word_to_code
from benchtool.explain.law_search import find_dependence
from benchtool.explain.pitch.replay import Replay, ReplayInputs
from benchtool.explain.pitch.replay_track import pitch_track
from benchtool.explain.result import Explanation
from benchtool.fit.compare_laws import LawComparison, LawScore
from benchtool.fit.motor.constants import MotorFit, fit_motor
from benchtool.fit.pool import RigValues, pool_rigs
from benchtool.fit.recipe import read_recipe
from benchtool.fit.run_recipe import FitOutput, run_recipe
from benchtool.report.compare.page import compare_runs
from benchtool.report.compare.pooled import PooledFits
from benchtool.report.flight.pitch_study import PitchStudy, pitch_study
from benchtool.report.replay.page import ReplayedLog
from benchtool.report.replay.replay_source import ReplaySource
from benchtool.report.sweep.run import SweepRun, read_sweep_run
from benchtool.simulate.flight.cases import flight_case
from benchtool.simulate.flight.study import FlownCase, fly_and_measure
from benchtool.simulate.flight.vehicle import FlightVehicle
from benchtool.simulate.gain_file import load_gains
from benchtool.simulate.inputs import PitchInputs
from benchtool.simulate.pitch.setup import pitch_setup
from tests.unit.explain.found_made import LAWS, shown
from tests.unit.explain.hand_made import answer
from tests.unit.fit.test_motor import swept

ROOT = Path(__file__).parents[2]


@cache
def fit(name: str) -> FitOutput:
    """Fit a shipped recipe by least squares."""
    recipe = read_recipe(ROOT / "fits" / name)
    return run_recipe(replace(recipe, methods=("least_squares",), compare=()))


@cache
def sampled_fit() -> FitOutput:
    """Return the quadrotor's fit with draws, as two ensembles of four walkers would make them."""
    found = fit("quad")
    result = found.results[0]
    draws = np.random.default_rng(0).multivariate_normal(result.values, result.covariance, 400)
    facts = {**result.facts, "ensembles": 2, "walkers": 4, "steps_kept": 50}
    scores = (
        LawScore(law="rotor_images", verdict="best", behind=0.0, behind_se=0.0),
        LawScore(law="hayden", verdict="behind", behind=3.1, behind_se=1.2),
    )
    return replace(
        found,
        results=(result, replace(result, method="emcee", samples=draws, facts=facts)),
        laws=LawComparison(scores=scores, distances=(0.6, 1.0, 2.0, 3.0)),
    )


@cache
def sweep() -> SweepRun:
    """Return the shipped run of the quadrotor, with samples made up and a calibration."""
    run = read_sweep_run(ROOT / "datasets" / "quad" / "run")
    points = run.points
    rows = np.repeat(np.arange(len(points)), 3)
    columns = {
        "time_s": points.column("time_s")[rows] + np.tile([0.0, 0.5, 1.0], len(points)),
        "point": points.column("point")[rows],
        "phase": np.full(len(rows), word_to_code("phase", "sample")),
    }
    for name in ("thrust_N", "rpm1", "pwm1_us", "plate_z_m"):
        columns[name] = points.column(name)[rows]
    units = {"time_s": "s", "thrust_N": "N", "rpm1": "rpm", "pwm1_us": "pwm_us", "plate_z_m": "m"}
    samples = Recording.from_columns(
        [(Channel(name, units.get(name, "1")), values) for name, values in columns.items()]
    )
    return replace(run, samples=samples)


def calibration() -> dict[str, Any]:
    """Return a calibration with three masses up and down."""
    return {
        "id": "cell-1", "gravity_m_s2": 9.81, "lever_ratio": 1.0, "simulated": True,
        "masses_kg": [0.0, 1.0, 2.0, 1.0, 0.0], "counts": [0.0, 1e3, 2e3, 1e3, 0.0],
        "residuals_N": [0.0, 0.001, 0.0, 0.003, 0.001],
    }  # fmt: skip


@cache
def study() -> PitchStudy:
    """Run the pitch bench for two seconds, the plate under one rotor from the first on."""
    setup = pitch_setup(PitchInputs(controllers=("pid",)))
    visit = PlateVisit(z_over_R=2.0, in_s=0.5, out_s=1.5, move_s=0.1)
    schedule = replace(setup.schedule, duration_s=2.0, plate=(visit,))
    return pitch_study(replace(setup, schedule=schedule), 1)


@cache
def log() -> ReplayedLog:
    """Return the recording of that run, its own attitude beside it as if simulated."""
    run = study().runs[0]
    recording = run.recording(study().setup.bench.model.rig, {})
    track = pitch_track(recording)
    recorded = ReplaySource(
        path=Path("hinge"), recording=recording, facts={}, provenance={}, sha256="0"
    )
    replay = Replay(
        model="pitch_pquad", rig="pquad", time_s=track.time_s, theta_rad=track.theta_rad,
        pwm_us=track.pwm_us, disturbance_Nm=np.empty(0), description="closed loop",
        driven_by="controller",
    )  # fmt: skip
    return ReplayedLog(recorded, track, ReplayInputs(model="pitch_pquad"), replay)


def stand() -> ReplaySource:
    """Return a recording of a stand without attitude."""
    return replace(log().recorded, recording=sweep_samples())


def sweep_samples() -> Recording:
    """Return the samples of the sweep."""
    found = sweep().samples
    assert found is not None
    return found


def flights() -> list[FlownCase]:
    """Fly one case for a second, out of ground effect and with it."""
    return [flown(None), flown(2.0)]


@cache
def flown(z_over_R: float | None) -> FlownCase:
    """Fly a plate under the front rotor for a second."""
    vehicle = FlightVehicle.of_rig(load_rig_by_name("pquad"))
    case = flight_case("plate", vehicle, load_gains("s3"), z_over_R=z_over_R)
    return fly_and_measure(replace(case, duration_s=1.0))


@cache
def motor() -> MotorFit:
    """Fit a virtual rotor's steps and single steps of the throttle."""
    with TemporaryDirectory() as folder:
        return fit_motor([swept(name, 1, Path(folder) / name) for name in ("steps", "response")])


@cache
def pooled_fits() -> PooledFits:
    """Pool three rigs made up, one parameter shared."""
    rigs = [
        RigValues(
            name=f"bench {n}",
            names=("body_lift.K_b", "R_over_rotor_radius"),
            values=np.array([1.9 + 0.05 * n, 1.0 + 0.05 * n]),
            covariance=np.array([[4e-4, -5e-5], [-5e-5, 1e-4]]),
        )
        for n in range(3)
    ]
    names = rigs[0].names
    return PooledFits(
        pooled=pool_rigs(rigs, names, names[:1]), units=dict.fromkeys(names, "1"),
        basis="joint", simulated=True, seed=1, hashes={},
    )  # fmt: skip


def with_law() -> Explanation:
    """Return an unknown that depends on rotor speed."""
    rng, made = np.random.default_rng(1), answer("unknown")
    speed = rng.uniform(0.7, 1.3, 150)
    depends = find_dependence(shown(LAWS["resonance"](speed), rng, speed), 0.12)
    return replace(made, depends=depends)


SUBJECTS: dict[str, Callable[[], Sequence[Any]]] = {
    "compare": lambda: [compare_runs([ROOT / "datasets" / "quad" / "run"], thrust_N=20.0)],
    "compare.pooled": lambda: [pooled_fits()],
    "answer": lambda: [answer(), answer("several"), answer("unknown"), with_law()],
    "fit": lambda: [sampled_fit(), fit("partial_area")],
    "flight": lambda: [flights()],
    "flight.pitch": lambda: [study()],
    "motor": lambda: [motor()],
    "replay": lambda: [log()],
    "replay.stand": lambda: [stand()],
    "sweep": lambda: [sweep()],
    "sweep.calibration": lambda: [calibration()],
    "sweep.compared": lambda: [[sweep(), sweep()]],
}
"""Of each page: what it may be of. A figure that none of them allows has no test."""
