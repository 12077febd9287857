"""Strict reading of model files, and round trips."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchtool.core.errors import FileFormatError, UnknownChoice
from benchtool.core.parameter import Prior
from benchtool.physics.conditions import Conditions
from benchtool.physics.model_file import load_model, model_from_toml, model_names, model_to_toml

HEAD = "[model]\nname = 'x'\nrig = 'pquad'\n"


@pytest.mark.parametrize("name", model_names())
def test_a_library_model_round_trips(name):
    loaded = load_model(name)
    again = model_from_toml(model_to_toml(loaded), "again.toml")
    assert dict(again.model.parameters) == dict(loaded.model.parameters)
    assert again.model.wake_rule == loaded.model.wake_rule
    assert [effect.name for effect in again.model.effects] == [
        effect.name for effect in loaded.model.effects
    ]
    conditions = (
        Conditions.build(
            loaded.model.rig, speed_rad_s=np.array([500.0]), plate_z_m=np.array([0.1, 0.2])
        )
        if loaded.model.rig.n_rotors == 1
        else Conditions.build(
            loaded.model.rig,
            speed_rad_s=np.full((loaded.model.rig.n_rotors, 1), 500.0),
            plate_z_m=np.array([0.1, 0.2]),
        )
    )
    assert np.array_equal(again.model.thrust_N(conditions), loaded.model.thrust_N(conditions))


def test_a_prior_bounds_and_tolerance_survive_the_file():
    loaded = load_model("quad_body_lift")
    item = replace(
        loaded.model.parameters["body_lift.K_b"],
        prior=Prior("normal", 2.0, 0.5, "assumed"),
        lower=0.5,
        upper=6.0,
        tolerance=0.1,
    )
    changed = replace(
        loaded,
        model=loaded.model.with_values(
            loaded.model.parameters.with_replaced("body_lift.K_b", item)
        ),
    )
    again = model_from_toml(model_to_toml(changed), "again.toml")
    assert again.model.parameters["body_lift.K_b"] == item


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("model = 3", FileFormatError, "model is 3: input should be a table"),
        (HEAD + "[effects.body_lif]", FileFormatError, "did you mean 'body_lift'"),
        (HEAD + "[effects.body_lift]\nKb = 2", FileFormatError, "did you mean 'body_lift.K_b'"),
        (HEAD + "[effects.body_lift]\nK_b = 'two'", FileFormatError, "K_b = 'two' is not a number"),
        (HEAD + "[effects.body_lift]\nK_b = {value=2, fre=true}", FileFormatError, "'free'"),
        (HEAD + "[effects.body_lift.settings]\na = 1", FileFormatError, "has no settings"),
        (HEAD + "[parameters]\nR_m = -1", FileFormatError, r"R_m is -1 m, outside its bounds"),
        (HEAD + "wake_rule = 'no'", FileFormatError, "unknown wake rule 'no'.*notes"),
        (HEAD + "body_distance = 'no'", FileFormatError, "half_diagonal"),
        (
            HEAD + "[discrepancy]\nthrust = 0",
            FileFormatError,
            "discrepancy thrust = 0 is out of range; allowed: above 0",
        ),
        (HEAD + "plate_slide_s = -1", FileFormatError, "plate_slide_s = -1 s is out of range"),
        ("[model]\nname = 'x'\nrig = 'pqad'", UnknownChoice, "did you mean 'pquad'"),
        (HEAD + "[columns]\nthrust_N = { unit = 'N' }", FileFormatError, "needs either column"),
        (
            HEAD + "[effects.partial_coverage.settings]\ncoverages = [0.5, 0.5]",
            FileFormatError,
            "do not increase between 0 and 1",
        ),
    ],
)
def test_an_invalid_file_is_rejected_with_a_message(text, error, message):
    with pytest.raises(error, match=message):
        model_from_toml(text, "x.toml")
