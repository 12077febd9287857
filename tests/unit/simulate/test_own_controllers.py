"""Controllers named as `module:Class`: found beside the user, or told why not."""

from __future__ import annotations

import pytest

from benchtool.core.errors import InputError
from benchtool.simulate.controllers.controller import load_controller_class


def allow(file: str) -> None:
    """Permit every file."""


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def test_a_class_beside_the_user_is_found(here):
    (here / "found_law.py").write_text(
        "class Law:\n    def step(self, m, r, dt_s):\n        return 0\n"
    )
    assert load_controller_class("found_law:Law", (), allow).__name__ == "Law"


@pytest.mark.parametrize(
    ("module", "text", "says"),
    [
        ("fails_law", "a = 1\nb = {}['gain']\n", r"raised KeyError: 'gain' .*fails_law\.py line 2"),
        ("quit_law", "a = 1\nraise SystemExit(2)\n", r"SystemExit: 2 .*quit_law\.py line 2; "),
        ("left_law", "\n\nexit()\n", r"SystemExit: None .*left_law\.py line 3; correct"),
        ("torn_law", "a = 1\ndef (:\n", r"raised SyntaxError: .*torn_law\.py, line 2"),
        ("other_law", "Law = 3\n", "has no class Law with a method step"),
        ("needs_law", "import no_such_package_at_all\n", "No module named"),
    ],
)
def test_what_cannot_be_imported_is_told_with_file_and_line(here, module, text, says):
    (here / f"{module}.py").write_text(text)
    with pytest.raises(InputError, match=says):
        load_controller_class(f"{module}:Law", (), allow)
