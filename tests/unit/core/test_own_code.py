"""Python of the user's own runs by permit only: never because a file of data names it."""

from __future__ import annotations

import pytest

from benchtool.bench.drivers import open_bench
from benchtool.commands.app import main
from benchtool.core.errors import InputError
from benchtool.explain.inputs import ExplainInputs
from benchtool.explain.request import read_request
from benchtool.fit.nominal import nominal_model
from benchtool.fit.recipe import Recipe
from benchtool.fit.run_recipe import run_recipe
from benchtool.physics.catalogue import user_effects
from benchtool.physics.model_file import load_model
from benchtool.simulate.controllers.controller import load_controller_class
from benchtool.simulate.inputs import PitchInputs
from benchtool.simulate.pitch.setup import pitch_setup

MODEL = '[model]\nname = "m"\nrig = "pquad_single"\neffects_file = "evil.py"\n'

CODE = """
from pathlib import Path
from dataclasses import replace
from benchtool.physics.catalogue import EFFECTS
Path(__file__).with_name("EXECUTED").touch()
EFFECT = replace(EFFECTS["plate_offset"], name="mine")
class Law:
    def step(self, m, r, dt_s):
        return 0.0
"""

ROWS = "thrust_N,rpm1,plate_z_m\n2.4,4500,0.06\n2.3,4500,0.24\n2.2,4500,0.72\n"


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, text in (("m.toml", MODEL), ("evil.py", CODE), ("t.csv", ROWS)):
        (tmp_path / name).write_text(text)
    fit = tmp_path / "fit"
    fit.mkdir()
    (fit / "recipe.toml").write_text(
        '[recipe]\nname = "f"\ndata = ["../t.csv"]\nmodel = "../m.toml"\n'
    )
    return tmp_path


WAYS = {
    "a model": lambda: load_model("m.toml"),
    "effects": lambda: user_effects("evil.py"),
    "a module": lambda: user_effects("evil"),
    "a controller": lambda: load_controller_class("evil:Law", ()),
    "an address": lambda: open_bench("sim:pquad_single?truth=m.toml"),
    "a pitch address": lambda: open_bench("sim:pquad?mode=pitch&truth=m.toml"),
    "a question": lambda: read_request(ExplainInputs(recordings=("t.csv",), model="m.toml")),
    "a recipe": lambda: run_recipe(Recipe(name="f", data=("t.csv",), model="m.toml")),
    "a compared model": lambda: run_recipe(
        Recipe(name="f", data=("t.csv",), model="single", rig="pquad_single", compare=("m.toml",))
    ),
    "a belief": lambda: nominal_model("m.toml", load_model("single").model.rig),
    "a setup": lambda: pitch_setup(PitchInputs(model="m.toml")),
}


@pytest.mark.parametrize("way", WAYS)
def test_nothing_runs_without_a_permit(here, way):
    with pytest.raises(InputError, match=r"evil\.py is user code"):
        WAYS[way]()
    assert not (here / "EXECUTED").exists()


@pytest.mark.parametrize(
    "words", [["fit", "--recipe", "fit"], ["sweep", "--resume", "run", "--dry-run"]], ids=" ".join
)
def test_what_data_name_does_not_run(here, capsys, words):
    begun = ["sweep", "sim:pquad_single", "--z-over-r", "1,2", "--pwm", "1450", "--repeats", "1"]
    with pytest.raises(SystemExit):
        main([*begun, "--sample-s", "0.2", "--yes", "--out", "run"])
    metadata, points = here / "run" / "metadata.json", here / "run" / "points.csv"
    told = metadata.read_text()
    assert '"address": "sim:pquad_single"' in told
    metadata.write_text(told.replace('"sim:pquad_single"', '"sim:pquad_single?truth=m.toml"'))
    points.write_text("\n".join(points.read_text().split("\n")[:3]) + "\n")
    capsys.readouterr()
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    assert "evil.py is user code" in capsys.readouterr().err
    assert not (here / "EXECUTED").exists()
