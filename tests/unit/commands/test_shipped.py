"""Commands `benchtool library rigs` and `models`: list, details, file text, errors."""

from __future__ import annotations

import pytest

from benchtool.core.user_file import read_library_file
from tests.unit.commands.command_line import said as run


@pytest.mark.parametrize(
    ("command", "name", "line"),
    [
        ("rigs", "pquad", "numbers are assumed (marked ?)"),
        ("models", "quad_body_lift", "effects: rotor_images, neighbour_images, body_lift"),
    ],
)
def test_an_entry_is_described_or_printed_as_toml(capsys, tmp_path, command, name, line):
    assert line in run(capsys, "library", command, name)[1]
    text = run(capsys, "library", command, name, "--toml")[1]
    assert text == read_library_file(command[:-1], command, name)[0]
    file = tmp_path / "own.toml"
    file.write_text(text, encoding="utf-8")
    assert line in run(capsys, "library", command, str(file))[1]


@pytest.mark.parametrize("toml", [[], ["--toml"]])
def test_invalid_rigs_and_models_are_rejected(capsys, tmp_path, toml):
    code, _, err = run(capsys, "library", "rigs", "pqad", *toml)
    assert code == 2
    assert "did you mean 'pquad'" in err
    torn = tmp_path / "torn.toml"
    torn.write_text("name = ", encoding="utf-8")
    for command in ("rigs", "models"):
        code, out, err = run(capsys, "library", command, str(torn), *toml)
        assert (code, out) == (2, "")
        assert "torn.toml" in err
