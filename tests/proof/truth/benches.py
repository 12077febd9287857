"""Simulated benches with known numbers: draw one, sweep it, and return the truth."""

from __future__ import annotations

from contextlib import redirect_stderr, redirect_stdout
from dataclasses import asdict, dataclass, replace
from functools import partial
from io import StringIO
from math import nan
from pathlib import Path

import numpy as np

from benchtool.acquire.average import average
from benchtool.acquire.measure import measure
from benchtool.acquire.motors import TareResult, tare_point
from benchtool.acquire.plan import (
    OrderPart,
    Plan,
    PlatePart,
    SettlePart,
    TarePart,
    ThrottlePart,
    plan_to_toml,
)
from benchtool.acquire.visit_order import plan_visits
from benchtool.api import sweep
from benchtool.bench.stage.stage import Pause, PlateStage
from benchtool.core.channel import Channel
from benchtool.core.recording import Recording
from benchtool.core.rig import PlateDrive, Rig
from benchtool.data.run.ratios import VOLTAGE_POWER_SD
from benchtool.data.run.run import Run
from benchtool.physics.conditions import MIN_MOVE
from benchtool.physics.model import Model
from benchtool.physics.model_file import LoadedModel, load_model, model_to_toml
from benchtool.simulate.imperfections import Imperfections
from benchtool.simulate.plate_bench import PlateBench

RATE_HZ = 80.0
MOVE_STEP_S = 0.2
SETTLE_S = 1.5  # of a visit's motors, thirty of their time constants

DISTANCES_OVER_R = (0.6, 0.8, 1.0, 1.5, 2.0, 3.0)
PULSES_US = (1450.0, 1600.0)
REPEATS = 3

Truth = dict[str, float]


@dataclass(frozen=True, slots=True)
class Drawn:
    """Hold one bench: what it was made with, its flaws, and its plan."""

    model: Model
    truth: Truth
    flaws: Imperfections
    plan: Plan
    seed: int
    supply_exponent: float  # of thrust over voltage, beyond the plant's own 2
    place_sd_m: float = 0.0  # how far the plate stands from where it is read, at each stay

    @property
    def rig(self) -> Rig:
        """The rig it stands for."""
        return self.model.rig


def drawn(seed: int, name: str) -> Drawn:
    """Draw a bench of a shipped model, its numbers from wide ranges about the shipped ones.

    k, R and K_b (where the model has it) are drawn evenly; the nuisances from the priors that the
    model states for them; drift about none; what thrust owes to the supply's voltage from what fits
    at equal pulses take it for. Noise, lag, sag, vibration, rounding and the
    wander of the load cell's zero are the virtual bench's own.
    """
    rng = np.random.default_rng([20261123, seed])
    model = load_model(name).model
    truth = {
        "k": model.parameters["k"].value * rng.uniform(0.9, 1.15),
        "R_m": model.rig.propulsion.radius_m * rng.uniform(0.92, 1.12),
        **({"body_lift.K_b": rng.uniform(1.2, 2.8)} if "body_lift.K_b" in model.parameters else {}),
        **{
            name: rng.normal(item.prior.mean, item.prior.sd)
            for name, item in model.parameters.items()
            if item.prior.kind == "normal"
        },
    }
    made = model
    for name, value in truth.items():
        made = made.with_fixed(name, value)
    plan = Plan(
        name="trial",
        repeats=REPEATS,
        sample_s=1.0,
        plate=PlatePart(distances_over_R=DISTANCES_OVER_R),
        throttle=ThrottlePart(pwm_us=PULSES_US),
        order=OrderPart(seed=seed, anchor_every=0),
        settle=SettlePart(window_s=0.6),
        tare=TarePart(every_minutes=0.0),
    ).resolved(model.rig)
    flaws = Imperfections(drift_N_per_s=rng.normal(0.0, 5e-5))
    return Drawn(made, truth, flaws, plan, seed, rng.normal(0.0, VOLTAGE_POWER_SD))


def misplaced(bench: Drawn, sd_m: float) -> Drawn:
    """Return the bench with a plate that finds a place again so well, as its rig states."""
    plate = replace(bench.rig.plate, repeatability_m=sd_m)
    model = replace(bench.model, rig=replace(bench.rig, plate=plate))
    return replace(bench, model=model, place_sd_m=sd_m)


def off_grid(bench: Drawn, step_m: float) -> Drawn:
    """Return the bench with distances that fall between the steps of their reading."""
    sensor = replace(bench.rig.sensors["plate_z_m"], quantum=step_m)
    rig = replace(bench.rig, sensors={**bench.rig.sensors, "plate_z_m": sensor})
    rng = np.random.default_rng([20261123, bench.seed, 2])
    distances_m = np.array(bench.plan.plate.distances_m)
    distances_m += step_m * rng.uniform(-0.5, 0.5, len(distances_m))
    plate = replace(bench.plan.plate, distances_m=tuple(distances_m.tolist()))
    plan = replace(bench.plan, plate=plate)
    return replace(bench, model=replace(bench.model, rig=rig), plan=plan)


def wandering(bench: Drawn, walk: float) -> Drawn:
    """Return the bench with a load cell whose zero walks so far: N/sqrt(s), as its rig states."""
    cell = replace(bench.rig.sensors["thrust_N"], walk=walk)
    rig = replace(bench.rig, sensors={**bench.rig.sensors, "thrust_N": cell})
    flaws = replace(bench.flaws, drift_walk_N_per_sqrt_s=walk)
    return replace(bench, model=replace(bench.model, rig=rig), flaws=flaws)


def new_run(bench: Drawn, path: Path) -> Run:
    """Return the bench's new, empty run."""
    facts = {"simulated": True, "rig": asdict(bench.rig)}
    return Run.create(path, plan_to_toml(bench.plan), facts)


def chained(bench: Drawn, path: Path) -> None:
    """Sweep the bench as a user does: `benchtool sweep sim:RIG?truth=FILE`, the rest as it ships.

    The file states the drawn numbers and the drift; other flaws, the play of the plate too, are
    those of tool and rig. Distances are the plan's: the law ends at z/R = 0.5, below which a drawn
    radius puts the nearest one of the default plan.
    """
    flaws = {"drift_N_per_s": bench.flaws.drift_N_per_s}
    truth = path.with_name("truth.toml")
    loaded = LoadedModel(model=bench.model, imperfections=flaws)
    truth.write_text(model_to_toml(loaded), "utf-8")
    address = f"sim:{bench.rig.name}?truth={truth}&seed={bench.seed}"
    plan = {"z_over_r": DISTANCES_OVER_R, "pwm": PULSES_US, "repeats": REPEATS}
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        sweep(address, yes=True, out=path, **plan)


class PlantStage(PlateStage):
    """The plate of a plant, with nothing watching."""

    def __init__(self, plant: PlateBench, plate: PlateDrive) -> None:
        super().__init__(plate)
        self._plant = plant

    def _move_once(self, z_m: float, x_m: float, tilt_rad: float, pause: Pause) -> float:
        self._plant.command_plate(z_m, x_m)
        while self._plant.plate_moving:
            pause(MOVE_STEP_S)
        return z_m


def visited(bench: Drawn, path: Path) -> None:
    """Sweep the same physics five times as fast: the plan's visits and points, nothing watching."""
    rig, plan = bench.rig, bench.plan
    plant = PlateBench(rig, bench.model, np.random.default_rng(bench.seed), bench.flaws, RATE_HZ)
    plant.tare()
    rest = average(samples(plant, 1.0).column("thrust_N"))
    tared = TareResult(plant.time_s - 0.5, nan)
    here_m, off_m = rig.plate.z_park_m, 0.0
    places = np.random.default_rng([20261123, bench.seed, 1])
    stage = PlantStage(plant, rig.plate)
    writer = new_run(bench, path).point_writer(rig.n_rotors)
    try:
        writer.append(tare_point(tared.time_s, rest, rig.n_rotors))
        for visit in plan_visits(plan, rig):
            plant.command_pwm(np.array(visit.pwm_us))
            if abs(visit.target_z_m - here_m) > MIN_MOVE:
                off_m = bench.place_sd_m * places.standard_normal()
            stage.move(visit.target_z_m + off_m, visit.target_x_m, 0.0, partial(samples, plant))
            samples(plant, SETTLE_S)
            here_m = visit.target_z_m
            read = samples(plant, plan.sample_s, bench.supply_exponent, off_m)
            point, _ = measure(read, visit, here_m, tared, rig.sensors, settled=True)
            writer.append(point)
    finally:
        writer.close()


def samples(
    plant: PlateBench, seconds: float, supply_exponent: float = 0.0, off_m: float = 0.0
) -> Recording:
    """Return what the bench streams over the next seconds, its plate nearer than it stands by off.

    The plant's speeds go with the voltage; an exponent beyond that scales speed, thrust and current
    as one.
    """
    start_s, n = plant.time_s, round(seconds * plant.rate_Hz)
    block = plant.advance(n)
    time_s = start_s + np.arange(1, n + 1) / plant.rate_Hz
    columns = dict(zip(plant.channels, block.T, strict=True))
    voltage = np.nanmean(columns[next(c for c in plant.channels if c.name == "voltage_V")])
    faster = (voltage / plant.rig.propulsion.voltage_nominal_V) ** (0.5 * supply_exponent)
    powers = {"rpm": 1, "thrust_N": 2, "current_A": 3}
    for channel in columns:
        columns[channel] *= faster ** powers.get(channel.name.rstrip("0123456789"), 0)
        columns[channel] -= off_m if channel.name == "plate_z_m" else 0.0
    return Recording.from_columns([(Channel("time_s", "s"), time_s), *columns.items()])
