"""Error handling of the command line: one line and one exit code per error."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Annotated

import numpy as np
import pytest

from benchtool.commands import app
from benchtool.commands.input_commands import command_from_inputs
from benchtool.core.errors import (
    BenchtoolError,
    DataWarning,
    EstimationError,
    LinkLost,
    UnknownChoice,
)
from benchtool.core.inputs import Input, Inputs

Run = Callable[..., tuple[int, str, str]]


@dataclass(frozen=True, slots=True, kw_only=True)
class TryInputs(Inputs):
    times: Annotated[int, Input("How often.")] = 1


@pytest.fixture
def run(monkeypatch, capsys):
    """Return a function that runs ``benchtool try``, a command of an action and an error."""
    monkeypatch.delenv("BENCHTOOL_DEBUG", raising=False)

    def call(
        *arguments: str,
        raising: BaseException | None = None,
        action: Callable[[], object] = lambda: None,
    ) -> tuple[int, str, str]:
        @command_from_inputs(TryInputs)
        def command(inputs: TryInputs) -> None:
            """Try something."""
            action()
            if raising is not None:
                raise raising

        module = ModuleType("benchtool.commands.try")
        module.command = command  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, module.__name__, module)
        commands = {"try": ("try:command", "Try something"), "absent": ("no:one", "Not loaded")}
        monkeypatch.setattr(app, "COMMANDS", commands)
        with pytest.raises(SystemExit) as leaving:
            app.main(arguments)
        printed = capsys.readouterr()
        return int(leaving.value.code or 0), printed.out, printed.err

    return call


@pytest.mark.parametrize(
    "error",
    [
        BenchtoolError("no"),
        LinkLost("the device went silent"),
        UnknownChoice("unit", "furlong", ["m", "s"]),
    ],
    ids=lambda error: type(error).__name__,
)
def test_benchtool_errors_are_one_line(run, error):
    assert run("try", raising=error) == (error.exit_code, "", f"benchtool: {error}\n")


def test_an_interrupt_exits_with_130(run):
    assert run("try", raising=KeyboardInterrupt())[0] == 130


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["tri"], "unknown command 'tri'; did you mean 'try'? known: absent, try"),
        (["doctor", "x"], "unknown command 'doctor'; known: absent, try"),
        (
            ["try", "--tims"],
            "No such option: --tims (Possible options: --times); see benchtool try --help",
        ),
        (["try", "--times", "x"], "--times is 'x'; type a whole number"),
    ],
)
def test_usage_errors_are_one_line(run, arguments, sentence):
    assert run(*arguments) == (2, "", f"benchtool: {sentence}\n")


def test_an_internal_error_writes_its_traceback(run, monkeypatch, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    code, _, err = run("try", raising=ZeroDivisionError("a\nb"))
    (file,) = tmp_path.iterdir()
    assert code == app.UNEXPECTED_ERROR_CODE
    assert err.startswith("benchtool: internal error, ZeroDivisionError: a b; ")
    assert err.count("\n") == 1
    assert str(file) in err
    assert "in command" in file.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "error",
    [
        np.linalg.LinAlgError("SVD did not converge"),
        ValueError("array must not contain infs or NaNs"),
    ],
)
def test_unsolvable_numbers_are_estimation_errors(run, error):
    code, _, err = run("try", raising=error)
    assert code == EstimationError.exit_code
    assert str(error) in err


HOSTILE, ESCAPED = "a\x1b[2Jb\u202ec\x9bd\te", "a\\x1b[2Jb\\u202ec\\u009bd\te"


def test_control_characters_are_escaped(run):
    assert run("try", raising=LinkLost(HOSTILE)) == (3, "", f"benchtool: {ESCAPED}\n")
    assert run("try", action=lambda: print(HOSTILE))[1] == f"{ESCAPED}\n"


def test_data_warnings_are_printed_and_python_warnings_are_not(run):
    def warn() -> None:
        warnings.simplefilter("default")
        warnings.warn("p.csv has changed\x07", DataWarning, stacklevel=1)
        warnings.warn("overflow in square", RuntimeWarning, stacklevel=1)

    assert run("try", action=warn)[2] == "benchtool: warning: p.csv has changed\\x07\n"
