"""The boundary where errors end: one sentence, one exit code."""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Annotated

import numpy as np
import pytest
import typer

from benchtool import __version__
from benchtool.commands import app
from benchtool.core.errors import (
    BenchtoolError,
    DataWarning,
    EstimationError,
    LinkLost,
    UnknownChoice,
)

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Give a call that runs ``benchtool`` with a command ``try`` which raises what it is given."""
    monkeypatch.delenv("BENCHTOOL_DEBUG", raising=False)

    def call(*words: str, raising: BaseException | None = None) -> tuple[int, str, str]:
        def command(times: Annotated[int, typer.Option(help="How often.")] = 1) -> None:
            """Try something."""
            if raising is not None:
                raise raising
            print("done", times)

        module = ModuleType("benchtool.commands.try")
        module.command = command  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, module.__name__, module)
        commands = {"try": ("try:command", "Try something"), "absent": ("no:one", "Not loaded")}
        monkeypatch.setattr(app, "COMMANDS", commands)
        with pytest.raises(SystemExit) as leaving:
            app.main(words)
        printed = capsys.readouterr()
        return int(leaving.value.code or 0), printed.out, printed.err

    return call


def test_a_command_runs(run: Run) -> None:
    assert run("try", "--times", "3") == (0, "done 3\n", "")


def test_no_words_show_the_help_with_commands_that_are_not_imported(run: Run) -> None:
    code, out, err = run()
    assert (code, err) == (0, "")
    assert re.search(r"^  try +Try something\n  absent +Not loaded$", out, re.MULTILINE)


def test_the_version_is_shown_alone(run: Run) -> None:
    assert run("--version") == (0, f"benchtool {__version__}\n", "")


@pytest.mark.parametrize(
    "error",
    [
        BenchtoolError("no"),
        LinkLost("the device went silent"),
        UnknownChoice("unit", "furlong", ["m", "s"]),
    ],
    ids=lambda error: type(error).__name__,
)
def test_our_errors_end_as_one_sentence(run: Run, error: BenchtoolError) -> None:
    assert run("try", raising=error) == (error.exit_code, "", f"benchtool: {error}\n")


def test_an_interrupt_ends_with_130(run: Run) -> None:
    assert run("try", raising=KeyboardInterrupt())[0] == 130


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["tri"], "unknown command 'tri'; did you mean 'try'? known: absent, try"),
        (
            ["try", "--tims"],
            "No such option: --tims (Possible options: --times); see benchtool try --help",
        ),
        (
            ["try", "--times", "x"],
            "Invalid value for '--times': Input should be a valid integer, unable to parse string "
            "as an integer (given: 'x'); see benchtool try --help",
        ),
    ],
)
def test_bad_words_end_as_one_sentence(run: Run, words: list[str], sentence: str) -> None:
    assert run(*words) == (2, "", f"benchtool: {sentence}\n")


def test_a_fault_keeps_its_traceback_in_a_file(
    run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    code, _, err = run("try", raising=ZeroDivisionError("a\nb"))
    (kept,) = tmp_path.iterdir()
    assert code == app.UNEXPECTED
    assert err.startswith("benchtool: a fault in benchtool itself, ZeroDivisionError: a b; ")
    assert err.count("\n") == 1
    assert str(kept) in err
    assert "in command" in kept.read_text(encoding="utf-8")


def test_a_fault_shows_its_traceback_when_asked(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BENCHTOOL_DEBUG", "1")
    with pytest.raises(ZeroDivisionError):
        run("try", raising=ZeroDivisionError())


@pytest.mark.parametrize(
    "error",
    [
        np.linalg.LinAlgError("SVD did not converge"),
        ValueError("array must not contain infs or NaNs"),
    ],
)
def test_numbers_that_cannot_be_solved_for_are_no_fault(run: Run, error: Exception) -> None:
    code, _, err = run("try", raising=error)
    assert code == EstimationError.exit_code
    assert str(error) in err


HOSTILE, SHOWN = "a\x1b[2Jb\u202ec\x9bd\te", "a\\x1b[2Jb\\u202ec\\u009bd\te"


def test_control_characters_are_shown_escaped(
    run: Run, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("try", raising=LinkLost(HOSTILE)) == (3, "", f"benchtool: {SHOWN}\n")
    module = ModuleType("benchtool.commands.hostile")
    module.hostile = lambda: print(HOSTILE)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(app, "COMMANDS", {"hostile": ("hostile:hostile", "Print")})
    with pytest.raises(SystemExit):
        app.main(["hostile"])
    assert capsys.readouterr().out == f"{SHOWN}\n"


def test_warnings_of_data_are_lines_and_those_of_python_are_not_shown(
    run: Run, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def warn() -> None:
        warnings.simplefilter("default")
        warnings.warn("p.csv has changed\x07", DataWarning, stacklevel=1)
        warnings.warn("overflow in square", RuntimeWarning, stacklevel=1)

    module = ModuleType("benchtool.commands.warn")
    module.warn = warn  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(app, "COMMANDS", {"warn": ("warn:warn", "Warn")})
    monkeypatch.delenv("BENCHTOOL_DEBUG", raising=False)
    with pytest.raises(SystemExit):
        app.main(["warn"])
    assert capsys.readouterr().err == "benchtool: warning: p.csv has changed\\x07\n"


def test_a_group_loads_the_subcommand_that_was_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    module = ModuleType("benchtool.commands.several")
    module.two = lambda: print("two ran")  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, module.__name__, module)
    commands = {
        "several": ("", "Try several things"),
        "several one": ("absent:one", "Try one"),
        "several two": ("several:two", "Try two"),
    }
    monkeypatch.setattr(app, "COMMANDS", commands)
    for words, shown in [(["several", "two"], "two ran\n"), (["several"], "Usage: benchtool sev")]:
        with pytest.raises(SystemExit):
            app.main(words)
        assert "".join(capsys.readouterr()).startswith(shown)


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("benchtool sw", "sweep"),
        ("benchtool simulate pi", "pitch"),
        ("benchtool sweep --repe", "--repeats"),
        ("benchtool sweep --order ", "randomised\ncounterbalanced\nas_given"),
        ("benchtool simulate flight --layout cr", "cross"),
    ],
)
def test_tab_completes(
    line: str,
    expected: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv(app.COMPLETING, "complete_bash")
    monkeypatch.setenv("COMP_WORDS", line)
    monkeypatch.setenv("COMP_CWORD", str(len(line.split()) - (not line.endswith(" "))))
    with pytest.raises(SystemExit):
        app.main([])
    assert capsys.readouterr().out.strip() == expected


def test_help_lists_options_under_headings(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        app.main(["sweep", "--help"])
    throttle = capsys.readouterr().out.partition("\nThrottle:\n")[2].partition("\n\n")[0]
    assert re.findall(r"^  (--\S+)", throttle, re.MULTILINE)[:2] == ["--pwm", "--throttle"]
