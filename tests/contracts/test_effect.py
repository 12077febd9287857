"""The contract of every effect in the catalogue."""

from __future__ import annotations

import ast
import inspect
import textwrap
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from benchtool.core.errors import InputError
from benchtool.core.parameter import Parameter
from benchtool.core.rig import Rig
from benchtool.core.rig_file import load_rig_by_name
from benchtool.physics import effects
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.conditions import Conditions
from benchtool.physics.effects.effect import (
    BENCH_KINDS,
    HOOKS,
    NO_FLOW,
    SUBSYSTEMS,
    Effect,
    Flow,
)
from benchtool.physics.model import OWN_IMAGES, Model
from benchtool.physics.precomputed import PrecomputedModel
from benchtool.physics.tolerances import default_tolerances
from tests.contracts.moving_effects import moving_thrust_N

BRANCHES = {"abs", "where", "select", "choose"}
"""What neither a complex step nor arrays and single numbers alike go through."""

EACH = pytest.mark.parametrize("name", sorted(EFFECTS))


def strong_value(name: str, item: Parameter) -> float:
    """Return a value of an effect's parameter well away from neutral and inside the bounds."""
    if item.neutral is None:
        return item.value
    known: dict[str, float] = {}
    for bench in BENCH_KINDS:
        known |= default_tolerances(EFFECTS[name], load_rig_by_name("beam"), bench)
    # A missing tolerance is named by its own test, and by no other.
    tolerance = known.get(item.name, 0.01 * min(item.upper - item.lower, 1.0))
    return float(np.clip(item.neutral + 20.0 * tolerance, item.lower, item.upper))


def acting(rig: Rig, name: str) -> Model:
    """Return a model in which the effect acts strongly."""
    effect = EFFECTS[name]
    values = {item.name: strong_value(name, item) for item in effect.parameters}
    return without_it(rig, name).with_effect(effect, **values)


def without_it(rig: Rig, name: str) -> Model:
    """Return a model without the effect: eq. (2) alone, and nothing where it is a law."""
    law = EFFECTS[name].distance_law
    if law is None:
        return Model.single(rig)
    bare = Model.single(replace(rig, plate=replace(rig.plate, surface=law.surface)))
    return bare.without(bare.effects[0].name)


@pytest.fixture
def rig():
    return load_rig_by_name("pquad")


@pytest.fixture
def conditions(rig):
    """Six distances, half of them with the plate over the front half only, from pulse widths."""
    return Conditions.build(
        rig,
        speed_rad_s=np.array([[560.0], [570.0], [580.0], [590.0]]),
        plate_z_m=np.array([0.1, 0.15, 0.2, 0.1, 0.3, 0.6]),
        plate_x_m=np.array([0.0, 0.0, 0.0, 0.6, 0.6, 0.0]),
        elapsed_s=60.0,
        time_s=60.0,
        airspeed_m_s=2.0,
        speed_measured=False,
    )


def test_every_file_of_the_folder_has_an_effect():
    folder = Path(effects.__path__[0])
    names = {path.stem for path in folder.glob("[!_]*.py")} - {"effect"}
    without = [n for n in names if not hasattr(import_module(f"{effects.__name__}.{n}"), "EFFECT")]
    assert not without, f"define EFFECT in {without}"


@EACH
def test_it_describes_itself(name):
    effect = EFFECTS[name]
    assert effect.subsystem in SUBSYSTEMS
    for text in (effect.title, effect.description, effect.law, effect.shows, effect.source):
        assert text
    assert effect.parameters
    for item in effect.parameters:
        assert item.description
        assert item.source
        if item.neutral is not None:
            assert item.lower <= item.neutral <= item.upper


@EACH
def test_it_says_what_does_not_matter_on_any_vehicle(name):
    """A tolerance of every parameter with a neutral value, with room within the bounds."""
    effect = EFFECTS[name]
    with_neutral = {item.name: item for item in effect.parameters if item.neutral is not None}
    for vehicle in ("beam", "pquad", "amuse_single"):
        rig = load_rig_by_name(vehicle)
        known = {bench: default_tolerances(effect, rig, bench) for bench in BENCH_KINDS}
        without = set(with_neutral) - {item for one in known.values() for item in one}
        assert not without, f"state a tolerance of {sorted(without)} of {name}"
        assert all(known[bench] for bench in effect.benches), f"state tolerances of {name}"
        for parameter, tolerance in (pair for one in known.values() for pair in one.items()):
            item = with_neutral[parameter]
            assert 0.0 < tolerance < 0.5 * (item.upper - item.lower)
            assert item.tolerance is None or tolerance == item.tolerance


TWO_SIDED = {  # parameters that physics leaves on both sides of neutral, and why
    "cog_offset.x_m": "a place lies on either side",
    "ground_shape.curvature": "a correction of a law",
    "gyro_bias.bias_rad_s": "a zero is off either way",
    "gyro_scale.scale": "a scale is off either way",
    "gyro_lag.late_s": "the encoder may be the later one",
    "hinge_spring.stiffness_Nm_per_rad": "a centre of gravity above the hinge is a negative spring",
    "lag_shape.rising": "an ESC may brake better than it drives",
    "lag_shape.with_speed": "an ESC's own controller quickens or slows a rotor",
    "load_cell_drift.rate_N_per_s": "a zero creeps either way",
    **{f"partial_coverage.share_{k}": "a curve bends either way" for k in (1, 2, 3)},
    "plate_offset.dz_m": "a zero is off either way",
    "plate_side.dx_m": "a place lies on either side",
    "plate_tilt.angle_rad": "a plate leans either way",
    "rotor_asymmetry.ratio": "either rotor is the stronger one",
    "speed_map.bend": "a curve bends either way",
    "speed_map.difference": "either rotor is the faster one",
    "speed_map.gain": "a scale is off either way",
    "tare_offset.thrust_N": "a zero is off either way",
    "thrust_exponent.excess": "an exponent is off either way",
}


@EACH
def test_physics_bounds_every_number_that_may_be_named(name):
    """A stand in the wake takes no negative share, a bearing has no negative friction."""
    for item in EFFECTS[name].parameters:
        if item.neutral is None or EFFECTS[name].distance_law is not None:
            continue
        assert np.isfinite(item.upper - item.lower)
        two_sided = item.lower < item.neutral < item.upper
        assert two_sided == (f"{name}.{item.name}" in TWO_SIDED)
        assert f"{name}.{item.name}" in TWO_SIDED or item.lower >= 0.0


def test_damping_counts_the_tip_speed_of_the_blades_not_of_the_effective_radius(rig):
    model = Model.single(rig).with_effect("aerodynamic_damping", coefficient=3.0)
    assert model.parameters["aerodynamic_damping.blade_radius_m"].value == rig.propulsion.radius_m
    effect = EFFECTS["aerodynamic_damping"]
    flow = NO_FLOW._replace(
        position_x_m=[0.25], thrust_N=[4.0], speed_rad_s=[600.0], rate_rad_s=0.5, radius_m=0.2
    )
    torque = effect.hooks.torque
    assert torque is not None
    found = torque(effect.build_p(3.0, rig.propulsion.radius_m), 0, flow)
    tip_m_s = 600.0 * rig.propulsion.radius_m
    assert found == pytest.approx(-3.0 * 0.5 * 0.25**2 * 4.0 / tip_m_s)


@EACH
def test_at_its_neutral_value_it_is_exactly_absent(name, rig, conditions):
    bare = without_it(rig, name)
    neutral = {
        item.name: item.neutral for item in EFFECTS[name].parameters if item.neutral is not None
    }
    with_it = bare.with_effect(name, **neutral)
    assert np.array_equal(with_it.thrust_N(conditions), bare.thrust_N(conditions))
    assert np.array_equal(moving_thrust_N(with_it, conditions, 1.0, 100), bare.thrust_N(conditions))


@EACH
def test_its_hooks_at_neutral_change_nothing_when_they_are_called(name, rig, conditions):
    """A freed effect is called even at neutral, and then must not move the prediction."""
    effect = EFFECTS[name]
    neutral = {item.name: item.neutral for item in effect.parameters if item.neutral is not None}
    bare = without_it(rig, name)
    model = bare.with_effect(name, **neutral).with_free(*(f"{name}.{key}" for key in neutral))
    assert name in [present.name for present in model.present_effects]
    np.testing.assert_allclose(
        model.thrust_N(conditions), bare.thrust_N(conditions), rtol=1e-14, atol=0.0
    )


@EACH
def test_moving_until_settled_equals_the_settled_case(name, rig, conditions):
    model = acting(rig, name)
    moving = moving_thrust_N(model, conditions, duration_s=60.0, steps=30_000)
    np.testing.assert_allclose(moving, model.thrust_N(conditions), rtol=1e-9)


def turning(pitch_rad: float = 0.3, rate_rad_s: float = 0.5) -> Flow:
    """Return what hooks see of a beam that turns, two rotors on it."""
    return Flow(
        radius_m=0.12,
        position_x_m=(0.25, -0.25),
        position_y_m=(0.0, 0.0),
        height_m=(0.2, 0.3),
        coverage=(1.0, 0.0),
        active=(1.0, 1.0),
        speed_rad_s=(560.0, 570.0),
        neighbour_images=(0.0, 0.0),
        body_images=(0.0, 0.0),
        body_weight=0.0,
        voltage_V=11.1,
        elapsed_s=60.0,
        time_s=60.0,
        pitch_rad=pitch_rad,
        rate_rad_s=rate_rad_s,
        cos_pitch=np.cos(pitch_rad),
        weight_N=13.7,
        thrust_N=(3.0, 3.1),
        acceleration_rad_s2=3.0,
    )


def hinge_outputs(effect: Effect, values: list[float], flow: Flow) -> list[float]:
    """Return all that an effect does to a hinge and its sensors, 0 where it has no hook."""
    hooks, p = effect.hooks, effect.build_p(*values)
    gyro, followed, after = hooks.gyro_reading, hooks.followed_speed, flow.speed_rad_s[0] + 1.0
    return [
        hooks.torque(p, 0, flow) if hooks.torque else 0.0,
        hooks.dry_friction(p, 0, flow) if hooks.dry_friction else 0.0,
        hooks.random_torque(p, 0, flow)[0] if hooks.random_torque else 0.0,
        hooks.delay_s(p, 0, flow) if hooks.delay_s else 0.0,
        hooks.lag_s(p, 0, flow) if hooks.lag_s else 0.0,
        gyro(p, 0, flow, flow.rate_rad_s) - flow.rate_rad_s if gyro else 0.0,
        followed(p, 0, flow, after) - after if followed else 0.0,
    ]


@EACH
@pytest.mark.parametrize("rate_rad_s", [-0.5, 0.0, 0.5])
def test_at_neutral_a_hinge_is_left_exactly_alone(name, rate_rad_s):
    effect = EFFECTS[name]
    p = [item.value if item.neutral is None else item.neutral for item in effect.parameters]
    assert hinge_outputs(effect, p, turning(rate_rad_s=rate_rad_s)) == [0.0] * 7


@EACH
def test_away_from_neutral_it_shows_somewhere(name, rig, conditions):
    """Lag alone hides on a settled bench, and a hinge shows only where there is one."""
    effect = EFFECTS[name]
    bare, model = without_it(rig, name), acting(rig, name)
    if effect.hooks.lag_s is not None:
        changed = moving_thrust_N(model, conditions, duration_s=0.02, steps=200)
    else:
        changed = model.thrust_N(conditions)
    on_thrust = float(np.max(np.abs(changed - bare.thrust_N(conditions))))
    p = [strong_value(name, item) for item in effect.parameters]
    moving = hinge_outputs(effect, p, turning()) + hinge_outputs(effect, p, turning(rate_rad_s=0.0))
    on_hinge = max(abs(value) for value in moving)
    assert max(on_thrust, on_hinge) > 1e-3


@pytest.mark.parametrize("name", [name for name, one in EFFECTS.items() if one.hooks.torque])
def test_a_torque_on_scalars_arrays_and_complex_steps_agrees(name):
    effect = EFFECTS[name]
    values = [strong_value(name, item) for item in effect.parameters]

    def torque(flow: Flow, first: complex = values[0]) -> Any:
        assert effect.hooks.torque is not None
        return effect.hooks.torque(effect.build_p(first, *values[1:]), 0, flow)

    angles = np.linspace(-0.4, 0.4, 7)
    whole = torque(turning()._replace(pitch_rad=angles, cos_pitch=np.cos(angles)))
    each = [torque(turning(pitch_rad=angle)) for angle in angles]
    np.testing.assert_allclose(np.broadcast_to(whole, (7,)), each, rtol=1e-15)
    exact = torque(turning(), values[0] + 1e-30j).imag / 1e-30
    step = [torque(turning(), values[0] + sign * 1e-4) for sign in (1.0, -1.0)]
    np.testing.assert_allclose(exact, (step[0] - step[1]) / 2e-4, rtol=1e-8)


def test_numbers_and_parameters_have_the_same_names():
    class P(NamedTuple):
        offset: float
        gain: float

    with pytest.raises(InputError, match="are offset, gain, its parameters own_strength"):
        replace(EFFECTS[OWN_IMAGES], numbers=P)


@EACH
def test_scalars_arrays_and_complex_steps_agree(name, rig, conditions):
    model = acting(rig, name)
    values = model.parameters.values_array()
    whole = model.thrust_N(conditions, values)
    for row in range(len(conditions)):
        one = model.thrust_N(conditions.select(np.array([row])), values)
        np.testing.assert_allclose(one[0], whole[row], rtol=1e-14)
    for position, (full_name, item) in enumerate(model.parameters.items()):
        if full_name.startswith("noise.") or item.neutral is None:
            continue
        step = 1e-6 * max(abs(item.value), 1e-2)
        up, down = values.copy(), values.copy()
        up[position] += step
        down[position] -= step
        central = (model.thrust_N(conditions, up) - model.thrust_N(conditions, down)) / (2 * step)
        shifted = values.astype(complex)
        shifted[position] += 1e-30j
        exact = model.thrust_N(conditions, shifted).imag / 1e-30
        np.testing.assert_allclose(exact, central, rtol=1e-5, atol=1e-7)


@EACH
def test_a_prepared_model_predicts_the_same(name, rig, conditions):
    model = acting(rig, name).with_free("k", "R_m")
    prepared = PrecomputedModel(model, conditions)
    walkers = {"k": np.array([[0.9e-5], [1.1e-5]]), "R_m": np.array([[0.11], [0.13]])}
    values = [walkers.get(name, item.value) for name, item in model.parameters.items()]
    got = prepared.thrust_N(values)
    assert got.shape == (2, len(conditions))
    np.testing.assert_allclose(got, model.thrust_N(conditions, values), rtol=1e-12)


@EACH
def test_its_hooks_branch_nowhere(name):
    for hook in HOOKS:
        function = getattr(EFFECTS[name].hooks, hook)
        if function is None:
            continue
        tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
        for node in ast.walk(tree):
            assert not isinstance(node, ast.If | ast.IfExp | ast.Match), hook
            if isinstance(node, ast.Call):
                called = node.func.attr if isinstance(node.func, ast.Attribute) else node.func
                word = called.id if isinstance(called, ast.Name) else called
                assert word not in BRANCHES, hook
