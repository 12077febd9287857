"""The contract of every effect in the catalogue."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.parameter import Parameter
from benchtool.core.rig import Rig
from benchtool.effects.catalogue import EFFECTS
from benchtool.effects.conditions import Conditions
from benchtool.effects.effect import STAGES
from benchtool.effects.model import Model
from benchtool.effects.moving import moving_thrust_N
from benchtool.effects.prepared import Prepared
from benchtool.library import rig_named

EACH = pytest.mark.parametrize("name", sorted(EFFECTS))


def strong_value(item: Parameter) -> float:
    """Return a value well away from neutral and inside the bounds."""
    if item.neutral is None:
        return item.value
    step = 20.0 * item.tolerance if item.tolerance else 0.5
    return float(np.clip(item.neutral + step, item.lower, item.upper))


def acting(rig: Rig, name: str) -> Model:
    """Return a model in which the effect acts strongly."""
    effect = EFFECTS[name]
    values = {item.name: strong_value(item) for item in effect.parameters}
    return Model.single(rig).with_effect(effect, **values)


@pytest.fixture
def rig() -> Rig:
    return rig_named("pquad")


@pytest.fixture
def conditions(rig: Rig) -> Conditions:
    """Six distances, half of them with the plate over the front half only, from pulse widths."""
    return Conditions.of(
        rig,
        speed_rad_s=np.array([[560.0], [570.0], [580.0], [590.0]]),
        plate_z_m=np.array([0.1, 0.15, 0.2, 0.1, 0.3, 0.6]),
        plate_x_m=np.array([0.0, 0.0, 0.0, 0.6, 0.6, 0.0]),
        elapsed_s=60.0,
        time_s=60.0,
        speed_measured=False,
    )


@EACH
def test_it_describes_itself(name: str) -> None:
    effect = EFFECTS[name]
    assert effect.stage in STAGES
    for text in (effect.title, effect.description, effect.law, effect.shows, effect.source):
        assert text
    assert effect.parameters
    for item in effect.parameters:
        assert item.description
        assert item.source
        if item.neutral is not None:
            assert item.tolerance is not None
            assert item.tolerance > 0.0
            assert item.lower <= item.neutral <= item.upper


@EACH
def test_at_its_neutral_value_it_is_exactly_absent(
    name: str, rig: Rig, conditions: Conditions
) -> None:
    bare = Model.single(rig)
    neutral = {
        item.name: item.neutral for item in EFFECTS[name].parameters if item.neutral is not None
    }
    with_it = bare.with_effect(name, **neutral)
    assert np.array_equal(with_it.thrust_N(conditions), bare.thrust_N(conditions))
    assert np.array_equal(moving_thrust_N(with_it, conditions, 1.0, 100), bare.thrust_N(conditions))


@EACH
def test_its_hooks_at_neutral_change_nothing_when_they_are_called(
    name: str, rig: Rig, conditions: Conditions
) -> None:
    """A freed effect is called even at neutral, and then must not move the prediction."""
    effect = EFFECTS[name]
    neutral = {item.name: item.neutral for item in effect.parameters if item.neutral is not None}
    bare = Model.single(rig)
    model = bare.with_effect(name, **neutral).freed(*(f"{name}.{key}" for key in neutral))
    assert [present.name for present in model.present_effects] == [name]
    np.testing.assert_allclose(
        model.thrust_N(conditions), bare.thrust_N(conditions), rtol=1e-14, atol=0.0
    )


@EACH
def test_moving_until_settled_equals_the_settled_case(
    name: str, rig: Rig, conditions: Conditions
) -> None:
    model = acting(rig, name)
    moving = moving_thrust_N(model, conditions, duration_s=60.0, steps=30_000)
    np.testing.assert_allclose(moving, model.thrust_N(conditions), rtol=1e-9)


@EACH
def test_away_from_neutral_it_shows_somewhere(name: str, rig: Rig, conditions: Conditions) -> None:
    """Lag alone hides on a settled bench; there it must show while the bench still moves."""
    bare, model = Model.single(rig), acting(rig, name)
    if EFFECTS[name].states and EFFECTS[name].states[0].drive == "speed_rad_s":
        changed = moving_thrust_N(model, conditions, duration_s=0.02, steps=200)
    else:
        changed = model.thrust_N(conditions)
    assert np.max(np.abs(changed - bare.thrust_N(conditions))) > 1e-3


@EACH
def test_scalars_arrays_and_complex_steps_agree(
    name: str, rig: Rig, conditions: Conditions
) -> None:
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
def test_a_prepared_model_predicts_the_same(name: str, rig: Rig, conditions: Conditions) -> None:
    model = acting(rig, name).freed("k", "R_m")
    prepared = Prepared(model, conditions)
    walkers = {
        "k": np.array([[0.9e-5], [1.1e-5]]),
        "R_m": np.array([[0.11], [0.13]]),
    }
    values = prepared.full_values(walkers)
    got = prepared.thrust_N(values)
    assert got.shape == (2, len(conditions))
    np.testing.assert_allclose(got, model.thrust_N(conditions, values), rtol=1e-12)
