"""Numbers that are not finite: every kind of file refuses them by the name of the field."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import inf, nan
from pathlib import Path

import pytest

from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.schedule import load_schedule
from benchtool.core.toml_text import read_strict
from benchtool.core.user_file import read_library_file
from benchtool.data.column_map import read_column_map
from benchtool.fit.recipe import read_recipe
from benchtool.physics.model_file import model_from_toml
from benchtool.simulate.flight.environment import Block, Environment, read_map
from benchtool.simulate.gain_file import parse_gains
from benchtool.simulate.imperfections import Imperfections

S3 = read_library_file("gain set", "gains", "s3")[0]
MODEL = "[model]\nname = 'm'\nrig = 'pquad'\n"
SCHEDULE = "name = 'x'\ntitle = 'x'\n"
STEP = f"{SCHEDULE}duration_s = 9.0\n"
RECIPE = "[recipe]\nname = 'r'\ndata = ['d']\nmodel = 'quad_bench'\n"


def of_text(parse: Callable[[str, str], object]) -> Callable[[Path], object]:
    return lambda path: parse(path.read_text(), "mine.toml")


def recipe(path: Path) -> object:
    return read_recipe(path.parent)


gains, model = of_text(parse_gains), of_text(model_from_toml)
imperfections = of_text(partial(read_strict, Imperfections))


@pytest.mark.parametrize("value", ["nan", "inf"])
@pytest.mark.parametrize(
    ("read", "text", "field"),
    [
        (gains, S3.replace("k_q_per_s = 7.4", "k_q_per_s = @"), "k_q_per_s"),
        (gains, S3.replace("control_rate_Hz = 250.0", "control_rate_Hz = @"), "control_rate_Hz"),
        (load_schedule, f"{SCHEDULE}duration_s = @\n", "duration_s"),
        (load_schedule, f"{STEP}reference_deg = [{{ shape = 'step', level = @ }}]", "level"),
        (load_schedule, f"{STEP}plate = [{{ z_over_R = @, in_s = 1, out_s = 2 }}]", "z_over_R"),
        (recipe, f"{RECIPE}min_z_over_R = @\n", "min_z_over_R"),
        (recipe, f"{RECIPE}[recipe.fix]\nR_m = @\n", "R_m"),
        (imperfections, "thrust_noise_N = @\n", "thrust_noise_N"),
        (imperfections, "battery_excess_V = @\n", "battery_excess_V"),
        (model, f"{MODEL}[imperfections]\nvibration_N = @\n", "vibration_N"),
        (model, f"{MODEL}[parameters.R_m]\nvalue = @\n", "R_m"),
        (model, f"{MODEL}[parameters]\nR_m = @\n", "R_m"),
        (model, f"{MODEL}[effects.body_lift]\nK_b = @\n", "K_b"),
        (read_column_map, "thrust_N = { column = 'T', factor = @ }\n", "factor"),
        (read_map, "[[blocks]]\nx_m = [0.0, 1.0]\ntop_m = @\n", "top_m"),
        (read_map, "[[blocks]]\nx_m = [0.0, 1.0]\nslide_m = [@, 0.0]\n", "slide_m"),
        (read_map, "floor_m = @\n", "floor_m"),
    ],
)
def test_it_is_refused_by_name(read, text, field, value, tmp_path):
    assert "@" in text
    path = tmp_path / "recipe.toml"
    path.write_text(text.replace("@", value))
    with pytest.raises(FileFormatError) as caught:
        read(path)
    assert field in str(caught.value)
    assert "\n" not in str(caught.value)


def test_imperfections_made_in_python_are_held_to_the_same():
    with pytest.raises(InputError, match="battery_excess_V is nan"):
        Imperfections(battery_excess_V=nan)
    with pytest.raises(InputError, match="motor_lag_s is inf"):
        Imperfections(motor_lag_s=inf)
    assert Imperfections().motor_lag_s != Imperfections().motor_lag_s  # nan: left to the rig


def test_places_of_plates_are_finite_and_ends_of_blocks_need_not_be():
    with pytest.raises(InputError, match="times_s"):
        Block(x_m=(0.0, 1.0), times_s=(0.0, 1.0, nan, 3.0))
    assert Environment(blocks=(Block(x_m=(0.0, inf)),)).floor_m == -inf
