"""Numbers that are not finite: every kind of file refuses them by the name of the field."""

from __future__ import annotations

from collections.abc import Callable
from math import inf, nan
from pathlib import Path

import pytest

from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.packaged import read_named
from benchtool.core.schedule_file import schedule_named
from benchtool.core.toml_text import read_strict
from benchtool.data.column_map import read_column_map
from benchtool.fit.recipe import read_recipe
from benchtool.physics.model_file import model_from_toml
from benchtool.simulate.flight.environment import Block, Environment
from benchtool.simulate.flight.map import read_map
from benchtool.simulate.gain_file import gains_from_toml
from benchtool.simulate.imperfections import Imperfections

S3 = read_named("gain set", "gains", "s3")[0]
MODEL = "[model]\nname = 'm'\nrig = 'pquad'\n"
SCHEDULE = "name = 'x'\ntitle = 'x'\n"
RECIPE = "[recipe]\nname = 'r'\ndata = ['d']\nmodel = 'quad_bench'\n"


def gains(text: str, folder: Path) -> object:
    return gains_from_toml(text, "mine.toml")


def model(text: str, folder: Path) -> object:
    return model_from_toml(text, "mine.toml")


def schedule(text: str, folder: Path) -> object:
    path = folder / "mine.toml"
    path.write_text(text)
    return schedule_named(path)


def recipe(text: str, folder: Path) -> object:
    (folder / "recipe.toml").write_text(text)
    return read_recipe(folder)


def columns(text: str, folder: Path) -> object:
    path = folder / "mine.toml"
    path.write_text(text)
    return read_column_map(path)


def imperfections(text: str, folder: Path) -> object:
    return read_strict(Imperfections, text, "mine.toml")


def yard(text: str, folder: Path) -> object:
    path = folder / "mine.toml"
    path.write_text(text)
    return read_map(path)


def with_gain(name: str, value: str) -> str:
    lines = [
        f"{name} = {{ value = {value}, source = 'test' }}" if line.startswith(f"{name} ") else line
        for line in S3.splitlines()
    ]
    assert "\n".join(lines) != S3
    return "\n".join(lines)


@pytest.mark.parametrize("value", ["nan", "inf"])
@pytest.mark.parametrize(
    ("read", "text", "field"),
    [
        (gains, lambda v: with_gain("k_q_per_s", v), "attitude.k_q_per_s"),
        (gains, lambda v: with_gain("control_rate_Hz", v), "control_rate_Hz"),
        (schedule, lambda v: f"{SCHEDULE}duration_s = {v}\n", "duration_s"),
        (
            schedule,
            lambda v: (
                f"{SCHEDULE}duration_s = 1.0\nreference_deg = [{{ shape = 'step', level = {v} }}]"
            ),
            "level",
        ),
        (
            schedule,
            lambda v: (
                f"{SCHEDULE}duration_s = 9.0\nplate = [{{ z_over_R = {v}, in_s = 1, out_s = 2 }}]"
            ),
            "z_over_R",
        ),
        (recipe, lambda v: f"{RECIPE}min_z_over_R = {v}\n", "min_z_over_R"),
        (recipe, lambda v: f"{RECIPE}[recipe.fix]\nR_m = {v}\n", "R_m"),
        (imperfections, lambda v: f"thrust_noise_N = {v}\n", "thrust_noise_N"),
        (imperfections, lambda v: f"battery_excess_V = {v}\n", "battery_excess_V"),
        (model, lambda v: f"{MODEL}[imperfections]\nvibration_N = {v}\n", "vibration_N"),
        (model, lambda v: f"{MODEL}[parameters.R_m]\nvalue = {v}\n", "R_m"),
        (model, lambda v: f"{MODEL}[parameters]\nR_m = {v}\n", "R_m"),
        (model, lambda v: f"{MODEL}[effects.body_lift]\nK_b = {v}\n", "K_b"),
        (columns, lambda v: f"thrust_N = {{ column = 'T', factor = {v} }}\n", "factor"),
        (yard, lambda v: f"[[blocks]]\nx_m = [0.0, 1.0]\ntop_m = {v}\n", "top_m"),
        (yard, lambda v: f"[[blocks]]\nx_m = [0.0, 1.0]\nslide_m = [{v}, 0.0]\n", "slide_m"),
        (yard, lambda v: f"floor_m = {v}\n", "floor_m"),
    ],
)
def test_it_is_refused_by_name(
    read: Callable[[str, Path], object],
    text: Callable[[str], str],
    field: str,
    value: str,
    tmp_path: Path,
) -> None:
    with pytest.raises(FileFormatError) as caught:
        read(text(value), tmp_path)
    message = str(caught.value)
    assert field in message
    assert "\n" not in message


def test_imperfections_made_in_python_are_held_to_the_same() -> None:
    with pytest.raises(InputError, match="battery_excess_V is nan"):
        Imperfections(battery_excess_V=nan)
    with pytest.raises(InputError, match="motor_lag_s is inf"):
        Imperfections(motor_lag_s=inf)
    assert Imperfections().motor_lag_s != Imperfections().motor_lag_s  # nan: left to the rig


def test_places_of_plates_are_finite_and_ends_of_blocks_need_not_be() -> None:
    with pytest.raises(InputError, match="times_s"):
        Block(x_m=(0.0, 1.0), times_s=(0.0, 1.0, nan, 3.0))
    assert Environment(blocks=(Block(x_m=(0.0, inf)),)).floor_m == -inf
