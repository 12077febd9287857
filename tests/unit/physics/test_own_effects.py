"""User-defined effects: import, error messages, use in a model file."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchtool.core.errors import InputError
from benchtool.physics.catalogue import user_effects
from benchtool.physics.model_file import load_model, model_from_toml, model_to_toml

GOOD = """
from typing import Any, NamedTuple

from benchtool.physics.effects.effect import Effect, Hooks, expression, number


class P(NamedTuple):
    c_Nms3: Any


@expression
def torque(p, i, flow):
    return -p.c_Nms3 * flow.rate_rad_s * flow.rate_rad_s * flow.rate_rad_s


EFFECT = Effect(
    name="cubic_damping",
    title="Cubic damping",
    description="A damper whose torque grows with the third power of the rate.",
    subsystem="hinge",
    law="torque = -c rate^3",
    numbers=P,
    parameters=(
        number(
            "c_Nms3", "1", 0.0, "strength", neutral=0.0, within=(0.0, 1.0), tolerance=0.002
        ),
    ),
    hooks=Hooks(torque=torque),
    shows="fast motion",
    source="assumed",
    confused_with={"viscous_friction": "slow and fast motion together separate them"},
    benches=frozenset({"pitch"}),
)
"""


def allow(file: str) -> None:
    """Permit all files."""


def write_file(folder: Path, text: str, name: str = "mine.py") -> str:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return str(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = 1\n", "contains no effect"),
        ("EFFECT = 3\n", "expected an Effect or a list"),
        ("EFFECTS = [3]\n", "contains 3, which is not an? "),
        ("import nothing_of_that_name\n", "nothing_of_that_name"),
        ("from benchtool.effects.effect import Effect\n", r"docs/how-to/extend\.md#effects"),
        (GOOD.replace("subsystem=", "stage="), r"'stage'.*docs/how-to/extend\.md#effects"),
        ("def broken(:\n", "SyntaxError"),
        ("1 / 0\n", "ZeroDivisionError"),
        ("\nexit(1)\n", r"SystemExit: 1 while it was imported, in .*mine\.py line 2; correct"),
        (GOOD.replace('"cubic_damping"', '"coulomb_friction"'), "name of an effect of benchtool"),
        (GOOD + "EFFECTS = [EFFECT]\n", "two effects named"),
        (GOOD.replace('frozenset({"pitch"})', "frozenset()"), "candidate on any bench"),
        (GOOD.replace(", tolerance=0.002", ""), "has no tolerance"),
    ],
)
def test_an_invalid_file_is_rejected_with_its_reason(tmp_path, text, message):
    with pytest.raises(InputError, match=message) as error:
        user_effects(write_file(tmp_path, text), allow)
    assert "\n" not in str(error.value)


def test_a_model_file_can_use_user_defined_effects(tmp_path):
    write_file(tmp_path, GOOD)
    model = tmp_path / "model.toml"
    model.write_text(
        '[model]\nname = "m"\nrig = "beam"\neffects_file = "mine.py"\n'
        "[effects.cubic_damping]\nc_Nms3 = 0.01\n",
        encoding="utf-8",
    )
    loaded = load_model(model, permit=allow)
    assert loaded.model.parameters["cubic_damping.c_Nms3"].value == 0.01
    again = model_from_toml(model_to_toml(loaded), str(model), permit=allow)
    assert again.effects_file == "mine.py"
    assert again.model.parameters["cubic_damping.c_Nms3"].value == 0.01
