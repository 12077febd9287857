"""`benchtool rigs` and `benchtool models`: the list, one of them, the file itself, refusals."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchtool.core.packaged import read_named
from benchtool.core.rig_file import rig_names
from benchtool.physics.model_file import model_names
from tests.unit.commands.command_line import said as run


@pytest.mark.parametrize(
    ("command", "name", "line"),
    [
        ("rigs", "pquad", "numbers are assumed (marked ?)"),
        ("models", "quad_body_lift", "effects: rotor_images, neighbour_images, body_lift"),
    ],
)
def test_one_of_them_is_shown_in_words_or_as_its_file(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, command: str, name: str, line: str
) -> None:
    assert line in run(capsys, command, name)[1]
    text = run(capsys, command, name, "--toml")[1]
    assert text == read_named(command[:-1], command, name)[0]
    own = tmp_path / "own.toml"
    own.write_text(text, encoding="utf-8")
    assert line in run(capsys, command, str(own))[1]


@pytest.mark.parametrize("toml", [[], ["--toml"]])
def test_what_is_no_rig_and_no_model_is_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, toml: list[str]
) -> None:
    code, _, err = run(capsys, "rigs", "pqad", *toml)
    assert code == 2
    assert "did you mean 'pquad'" in err
    torn = tmp_path / "torn.toml"
    torn.write_text("name = ", encoding="utf-8")
    for command in ("rigs", "models"):
        code, out, err = run(capsys, command, str(torn), *toml)
        assert (code, out) == (2, "")
        assert "torn.toml" in err


@pytest.mark.parametrize(("command", "names"), [("rigs", rig_names()), ("models", model_names())])
def test_each_that_ships_has_a_line(
    capsys: pytest.CaptureFixture[str], command: str, names: tuple[str, ...]
) -> None:
    code, out, _ = run(capsys, command)
    assert code == 0
    shown = [line.split()[0] for line in out.splitlines()]
    assert shown[: len(names)] == list(names)
    assert shown[len(names) :] in ([], ["yours,"])
