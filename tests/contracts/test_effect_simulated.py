"""The contract of every effect on a pitch bench and in flight: the same hooks as in a sweep."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchtool.core.rig import Rig
from benchtool.core.rig_file import load_rig_by_name
from benchtool.core.schedule import PlateVisit, SampledSchedule, Schedule, Signal
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.conditions import Conditions
from benchtool.physics.images import TILT_RULES, height_over, plate_plane
from benchtool.physics.model import OWN_IMAGES, Model
from benchtool.simulate.controllers.laws import build_pitch_controller
from benchtool.simulate.flight.cases import FlightCase, Goal
from benchtool.simulate.flight.environment import Block, Environment
from benchtool.simulate.flight.flight import Flight, FlightLoop, fly
from benchtool.simulate.flight.vehicle import FlightVehicle
from benchtool.simulate.gain_file import load_gains
from benchtool.simulate.hooks import joined_hooks, loop_effects, loop_numbers
from benchtool.simulate.pitch.bench import PitchBench
from benchtool.simulate.pitch.lane import heights_over, plane_below
from benchtool.simulate.pitch.run import PitchJob, PitchLoop
from tests.contracts.test_effect import EACH, acting, without_it
from tests.unit.simulate.flying import look_below

ON_A_LOAD_CELL = ("thrust_reading", "play_N")
IN_MOVING_AIR = ("forward_speed",)  # nothing on a hinge at rest
RIG = load_rig_by_name("pquad")
WALL = Environment(blocks=(Block(x_m=(0.2, 3.0)),), floor_m=-0.3)
FLOOR = Environment(floor_m=0.0)
COVERED = (1.0, 0.6, 0.1, 0.6)  # shares of the discs over a pitch bench's plate


def neutral(rig: Rig, name: str) -> Model:
    """Return a model with the effect in it, where it does nothing."""
    items = EFFECTS[name].parameters
    values = {item.name: item.neutral for item in items if item.neutral is not None}
    return without_it(rig, name).with_effect(name, **values)


def flown(model: Model) -> Flight:
    """Return a short flight with an edge under the front rotor, run without a compiler."""
    case = FlightCase(
        name="short", vehicle=FlightVehicle(model=model), gains=load_gains("s3"), below=WALL,
        control="both", start_m=(0.0, 0.0, 0.2), goals=(Goal(x_m=1.0, y_m=0.5, z_m=0.25),),
        duration_s=0.12, log_Hz=250.0, gyro_noise_rad_s=0.1,
    )  # fmt: skip
    loop = FlightLoop(case)
    loop.ended = loop.loops.run.py_func(loop.arrays, -1, loop.n_ticks)
    return loop.flight()


def schedule() -> SampledSchedule:
    steps = Signal(shape="steps", levels=(5.0, -5.0), every_s=0.06)
    visit = PlateVisit(z_over_R=1.2, in_s=0.0, out_s=1.0, move_s=0.0)
    parts = Schedule(name="s", title="s", duration_s=0.12, reference_deg=(steps,), plate=(visit,))
    return parts.sampled(250.0, RIG.propulsion.radius_m)


def hinged(model: Model) -> np.ndarray:
    """Return the log of a short pitch run, run without a compiler."""
    control = build_pitch_controller("pid", load_gains("s3"))
    bench = replace(
        PitchBench.from_model(model, covered=COVERED), model=model
    )  # without the rig's lag
    loop = PitchLoop([PitchJob(bench, control)], schedule(), 4, [0])
    loop.view("hinge.theta_rad")[:] = 0.15
    loop.loops.run.py_func(loop.arrays, 0, len(loop.schedule))
    return loop.log[:, :, 0]


@cache
def bare_logs(without_own_images: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the logs on a hinge and in flight of a model that has no effect but eq. (2)."""
    bare = Model.single(RIG)
    bare = bare.without(OWN_IMAGES) if without_own_images else bare
    return hinged(bare), flown(bare).log


def most_changed(one: np.ndarray, other: np.ndarray) -> float:
    """Return the largest difference over the size of its column."""
    with np.errstate(invalid="ignore"):
        size = np.nanmax(np.abs(np.where(np.isfinite(one), one, 0.0)), axis=0)
        return float(np.nanmax(np.abs(one - other) / np.maximum(size, 1e-6)))


@EACH
def test_at_neutral_it_is_exactly_absent_on_a_hinge_and_in_flight(name):
    on_a_hinge, in_flight = bare_logs(EFFECTS[name].distance_law is not None)
    assert np.array_equal(hinged(neutral(RIG, name)), on_a_hinge, equal_nan=True)
    assert np.array_equal(flown(neutral(RIG, name)).log, in_flight, equal_nan=True)


@EACH
def test_away_from_neutral_it_shows_on_a_hinge_and_in_flight_where_it_belongs(name):
    """What belongs to a load cell shows in a sweep, what belongs to a bench not in flight."""
    effect, model = EFFECTS[name], acting(RIG, name)
    bare = bare_logs(effect.distance_law is not None)
    hooks = [hook for hook in effect.hooks.__slots__ if getattr(effect.hooks, hook)]
    on_a_hinge = most_changed(bare[0], hinged(model))
    in_flight = most_changed(bare[1], flown(model).log)
    shows = name not in IN_MOVING_AIR and any(hook not in ON_A_LOAD_CELL for hook in hooks)
    assert (on_a_hinge > 1e-6) == shows
    assert (in_flight > 1e-6) == effect.acts_in_flight
    assert FlightVehicle(model=model).idle_effects == (() if effect.acts_in_flight else (effect,))


@EACH
@pytest.mark.parametrize("z_over_R", [1.0, 1.5, 4.0])
def test_settled_it_is_on_a_hinge_and_in_flight_what_a_sweep_shows(name, z_over_R):
    """The thrust factor of every disc over a plate that lies under all of them."""
    model = acting(RIG, name)
    z_m, n = z_over_R * RIG.propulsion.radius_m, RIG.n_discs
    settled = Conditions.build(
        RIG, speed_rad_s=np.full((n, 1), 550.0), plate_z_m=np.array([z_m]),
        coverage=np.ones((n, 1)),
    )  # fmt: skip
    values = model.parameters.values_array()
    swept = np.ravel(model.disc_factors(model.flow(settled, values), values))
    effects = loop_effects(model)
    hooks = joined_hooks(effects, n, model.image_rules)()
    same, places, p = (550.0,) * n, RIG.disc_positions_m, loop_numbers(model, effects)
    plane = plate_plane(z_m, 0.0, hooks.tilt(p))
    heights = tuple(height_over(plane, *place) for place in places)
    radius_m = model.parameters["R_m"].value
    flow = hooks.bare(radius_m, *places.T, plane, heights, (1.0,) * n, same)
    flow = hooks.with_images(flow, RIG.disc_distances_m, model.body_images, p)
    np.testing.assert_allclose(hooks.factors(flow, p), swept, rtol=1e-13)
    below = look_below(FlightVehicle(model=model), FLOOR, (0.0, 0.0, z_m))
    if not EFFECTS[name].acts_in_flight:
        values = without_it(RIG, name).parameters.values_array()
        bare = without_it(RIG, name)
        swept = np.ravel(bare.disc_factors(bare.flow(settled, values), values))
    np.testing.assert_allclose(below.factor, swept, rtol=1e-13)


@pytest.mark.parametrize("rule", TILT_RULES)
@pytest.mark.parametrize("pitch_rad", [-0.1, 0.17])
def test_a_tilt_is_the_same_in_a_sweep_on_a_hinge_and_in_flight(rule, pitch_rad):
    """A plate that leans under a level vehicle, and a vehicle that leans over a level surface."""
    model, n, z_m = replace(FlightVehicle.of_rig(RIG).model, tilt_rule=rule), RIG.n_discs, 0.2
    settled = Conditions.build(
        RIG, speed_rad_s=np.full((n, 1), 550.0), plate_z_m=np.array([z_m / np.cos(pitch_rad)]),
        plate_tilt_rad=pitch_rad, coverage=np.ones((n, 1)),
    )  # fmt: skip
    values = model.parameters.values_array()
    swept = np.ravel(model.disc_factors(model.flow(settled, values), values))
    hooks = joined_hooks(loop_effects(model), n, model.image_rules)()
    p, x, y = loop_numbers(model, loop_effects(model)), *RIG.disc_positions_m.T
    plane = plane_below(z_m, pitch_rad, hooks.tilt(p))
    flow = hooks.bare(
        RIG.propulsion.radius_m, x, y, plane, heights_over(plane, tuple(x), y), (1.0,) * n,
        (550.0,) * n, pitch=pitch_rad,
    )  # fmt: skip
    flow = hooks.with_images(flow, RIG.disc_distances_m, model.body_images, p)
    np.testing.assert_allclose(hooks.factors(flow, p), swept, rtol=1e-9)
    below = look_below(FlightVehicle(model=model), FLOOR, (0.0, 0.0, z_m), 0.0, (0, pitch_rad, 0))
    np.testing.assert_allclose(below.factor, swept, rtol=1e-13)


def test_another_law_flies_in_the_place_of_eq_2():
    """Without any image a surface does nothing; with eq. (2) written as a curvature it does."""
    nothing = Model.single(RIG).without(OWN_IMAGES)
    over = (0.0, 0.0, 0.15)
    assert look_below(FlightVehicle(model=nothing), FLOOR, over).factor == (1.0,) * 4
    other = FlightVehicle(model=nothing.with_effect("ground_shape", curvature=0.5))
    own = (RIG.propulsion.radius_m / 0.6) ** 2
    expected = 1.0 / (1.0 - 0.5 * own**2)
    np.testing.assert_allclose(look_below(other, FLOOR, over).factor, expected, rtol=1e-14)
    case = FlightCase(
        name="over", vehicle=other, gains=load_gains("s3"), below=FLOOR, start_m=over,
        duration_s=0.2,
    )  # fmt: skip
    np.testing.assert_allclose(fly(case)["factor1"], expected, rtol=1e-2)


def test_a_hidden_bias_and_a_delay_show_as_they_say():
    """A gyro that shows a rate tilts the vehicle; a late command lets it drop behind."""
    calm = replace(
        FlightCase(
            name="calm", vehicle=FlightVehicle.of_rig(RIG), gains=load_gains("s3"),
            start_m=(0.0, 0.0, 1.0), goals=(Goal(x_m=0.5, z_m=1.0, from_s=0.4),), duration_s=4.0,
        ),
        log_Hz=250.0,
    )  # fmt: skip
    plain = fly(calm)
    biased = fly(replace(calm, vehicle=calm.vehicle.with_numbers(bias_rad_s=0.02)))
    late = fly(replace(calm, vehicle=calm.vehicle.with_numbers(delay_s=0.0213)))
    waiting = plain["time_s"] < 0.4
    assert np.abs(plain["pitch_rad"][waiting]).max() < 1e-12
    assert np.abs(biased["pitch_rad"][waiting]).max() > 3e-3
    first = [int(np.argmax(np.abs(flight["q_rad_s"]) > 1e-6)) for flight in (plain, late)]
    assert (first[1] - first[0]) / 250.0 == pytest.approx(0.0213, abs=0.004)


def test_a_vehicle_whose_bench_has_its_plate_above_flies_over_floors():
    above = replace(RIG, plate=replace(RIG.plate, surface="above"))
    over = (0.0, 0.0, 0.2)
    swept, flown_over = (FlightVehicle.of_rig(rig) for rig in (RIG, above))
    expected = look_below(swept, FLOOR, over).factor
    assert look_below(flown_over, FLOOR, over).factor == expected
    assert expected[0] > 1.1
