"""The command line's entry: the table of commands and the one boundary where errors end.

Only the module of the requested command is imported; the others appear in the help by
their line in `COMMANDS`. A module has a ``Parser`` where its words are taken in a way of their own.
"""

from __future__ import annotations

import errno
import os
import sys
import warnings
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from benchtool import __version__
from benchtool.commands.input_commands import GroupedCommand, option_help
from benchtool.commands.terminal.messages import (
    EscapedStream,
    cause_behind,
    flush_output,
    say_error,
)
from benchtool.core.errors import (
    BenchtoolError,
    DataWarning,
    InputError,
    UnknownChoice,
    show_warning,
)
from benchtool.core.inputs import items
from benchtool.core.user_file import display_path

COMMANDS: dict[str, tuple[str, str]] = {
    "demo": ("demo:demo", "Sweep a virtual bench, fit, and write a report"),
    "sweep": ("sweep:sweep", "Sweep plate distance and throttle into a run folder"),
    "record": ("record:record", "Record a pitch experiment from a bench into a run folder"),
    "runs": ("", "Find, tag, query, merge and verify runs"),
    "runs list": ("runs:list_",
        "List runs, fits and recordings, chosen by rig, date, distance, tag and more"),
    "runs search": ("runs:search",
        "Find runs by words that stand anywhere in name, rig, date, tags, notes"),
    "runs query": ("runs:query",
        "Query points, samples and fits of all that is chosen with SQL (DuckDB)"),
    "runs show": ("runs:show",
        "Show what the catalogue knows of runs and fits, with their tags and notes"),
    "runs compare": ("runs:compare",
        "Set runs side by side: what they are, and T_IGE/T_OGE by z/R; report draws them"),
    "runs tag": ("runs:tag",
        "Give runs and fits tags, or take some away; without --add and --remove, show them"),
    "runs note": ("runs:note", "Write a note about a run or fit, with the date and who wrote it"),
    "runs verify": ("runs:verify",
        "Check runs against the hashes that they state; exit code 2 where one differs"),
    "runs export": ("runs:export",
        "Write samples, points or settings of a run as MCAP, Parquet or CSV"),
    "runs merge": ("runs:merge",
        "Merge several runs of one rig and propeller into a new run folder"),
    "runs close": ("runs:close",
        "Mend what a killed program left of runs and write their tables; safe to repeat"),
    "calibrate": ("calibrate:calibrate", "Calibrate a load cell with known masses"),
    "recalibrate": ("runs:recalibrate_run", "Apply a calibration to a run, its raw data untouched"),
    "import": ("import_file:import_", "Import flight logs and other makers' files, repairs listed"),
    "fit": ("fit:fit", "Fit a ground-effect model to run folders or any CSV"),
    "pool": ("pool:pool", "Pool fits of rigs: mean, spread, and which rigs differ"),
    "motor": ("motor:motor", "Fit thrust curve and motor constants to tests without a plate"),
    "export": ("export:export", "Write a fitted model for simulators, autopilots and firmware"),
    "explain": ("explain:explain", "Name the effect that a model lacks, and show the gap shrink"),
    "report": ("report:report", "Write a report page of a run, fit or recording"),
    "simulate": ("", "Simulate benches and flights near surfaces in closed loop"),
    "simulate pitch": ("simulate_pitch:pitch", "Simulate the pitch bench under each controller"),
    "simulate flight": ("simulate_flight:flight",
        "Simulate flights over an obstacle under each controller"),
    "stop": ("stop:stop",
        "Stop the motors of every bench of this user"),
    "web": ("web:web", "Serve a page to watch, sweep, fit and explain in a browser"),
    "bench": ("", "Serve a virtual bench; check a bench before motors spin"),
    "bench check": ("bench_check:check",
        "Check standstill, ESC arming, channel map, thrust sign and rpm at low throttle"),
    "bench map": ("bench_check:map_motors",
        "Turn each motor of a flight controller alone, slowly, and write down what it drives"),
    "bench serve": ("bench:serve",
        "Run a virtual bench on a pseudo-terminal, TCP port or MAVLink until Ctrl-C"),
    "firmware": ("firmware:firmware", "Write the firmware that makes an Arduino a rotor bench"),
    "ports": ("ports:ports", "List serial ports and, with --probe, what answers on them"),
    "doctor": ("ports:doctor", "Explain what keeps a serial port from working"),
    "rigs": ("library_commands:rigs", "List rigs, or show one with the source of every number"),
    "rigs new": ("rig_new:new_rig", "Write a rig file of your own, asking what its use needs"),
    "propellers": ("library_commands:propellers",
        "List propellers, or show one with the source of every number"),
    "models": ("library_commands:models",
        "List models, or show one with its effects and parameters"),
    "effects": ("library_commands:effects",
        "List physical effects, or show one with law and parameters"),
}  # fmt: skip
"""Each command, in the order of the help: "module:function" in this package ("" for a group of
subcommands) and its line there, which is also the first line of the command's docstring."""

_OF_A_NAME = {  # system errors of a path that cannot be one, wherever it was typed
    *(errno.ENOENT, errno.ENAMETOOLONG, errno.ENOTDIR, errno.EISDIR, errno.EEXIST, errno.ELOOP)
}

COMPLETING = "_BENCHTOOL_COMPLETE"  # set by a shell's completion script
UNEXPECTED_ERROR_CODE = (
    70  # exit code of a fault in benchtool itself (EX_SOFTWARE of BSD's sysexits.h)
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and leave the process with its exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if COMPLETING in os.environ:
        words = _words_to_complete()
    for stream in (sys.stdout, sys.stderr):
        # A console that cannot show a character gets a stand-in for it instead of a traceback.
        if reconfigure := getattr(stream, "reconfigure", None):
            reconfigure(errors="replace")
    with (
        redirect_stdout(EscapedStream(sys.stdout)),
        redirect_stderr(EscapedStream(sys.stderr)),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("default", DataWarning)
        if not os.environ.get("BENCHTOOL_DEBUG"):
            warnings.showwarning = show_warning
        _run(words)


def _run(words: list[str]) -> None:
    """Run one command and leave the process with its exit code."""
    try:
        _check_text(words)
        code = build_app(words)(args=words, prog_name="benchtool", standalone_mode=False)
        flush_output()
        sys.exit(code if isinstance(code, int) else 0)
    except typer.TyperException as error:
        say_error(_describe_misuse(error, words))
        sys.exit(error.exit_code)
    except typer.Abort:
        say_error("aborted; nothing was answered")
        sys.exit(1)
    except BenchtoolError as error:
        say_error(str(error))
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        sys.exit(130)
    except Exception as error:
        if os.environ.get("BENCHTOOL_DEBUG"):
            raise
        if isinstance(error, OSError) and error.errno in _OF_A_NAME and error.filename:
            reason = (error.strerror or "it cannot be used").lower()
            say_error(f"{display_path(error.filename)}: {reason}; name another")
            sys.exit(InputError.exit_code)
        if (cause := cause_behind(error)) is not None:
            say_error(str(cause))
            sys.exit(cause.exit_code)
        say_error(_describe_fault(error))
        sys.exit(UNEXPECTED_ERROR_CODE)


def _words_to_complete() -> list[str]:
    """Return the command of the line that a shell wants completed, as far as it is written."""
    line = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS", "")
    words = [word for word in line.split()[1:] if not word.startswith("-")]
    for most in (2, 1):
        if " ".join(words[:most]) in COMMANDS:
            return words[:most]
    return []


def _check_text(words: Sequence[str]) -> None:
    """Refuse a word that is no UTF-8 text: it could be neither stored nor shown."""
    for word in words:
        try:
            word.encode()
        except UnicodeEncodeError:
            shown = word[:60].encode("ascii", "backslashreplace").decode()
            raise InputError(f"the word {shown} is not UTF-8 text; write it otherwise") from None


def build_app(words: Sequence[str]) -> typer.Typer:
    """Assemble the application for one invocation, importing at most one command."""
    sets_up = words[:1] in (["--install-completion"], ["--show-completion"])
    app = typer.Typer(
        cls=_Group,
        help="Drive rotor test benches near surfaces and fit ground-effect models.",
        epilog="benchtool --install-completion sets up completion with Tab.",
        # Its options are added where they are given: with them, every call would import pydantic.
        add_completion=sets_up or COMPLETING in os.environ,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
    )
    app.callback()(_options)
    named = [] if sets_up else [word for word in words if not word.startswith("-")]
    if named and named[0] not in COMMANDS:
        raise UnknownChoice("command", named[0], [name for name in COMMANDS if " " not in name])
    groups: dict[str, typer.Typer] = {"": app}
    for name, (where, line) in COMMANDS.items():
        group, _, last = name.rpartition(" ")
        if not where or (len(named) > 1 and f"{name} {named[1]}" in COMMANDS):
            groups[name] = typer.Typer(cls=_Group, rich_markup_mode=None, add_completion=False)
            groups[name].callback()(_unloaded)
            app.add_typer(
                groups[name], name=name, cls=_Group, help=f"{line}." if name in named else line
            )
        elif group and group not in groups:
            continue  # a command of that name takes the words
        elif name.split() == named[: 1 + bool(group)]:
            module = import_module(command_module(name))
            called = getattr(module, where.partition(":")[2])
            groups[group].command(last, cls=getattr(module, "Parser", GroupedCommand))(called)
        else:
            groups[group].command(last, help=f"{line}." if group else line)(_unloaded)
    return app


class _Group(TyperGroup):
    """A group that shows its help without a word and converts no value on the way to a command.

    A help option that was not given has no value, and to convert that one typer imports pydantic;
    False needs no conversion.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        return super().parse_args(ctx, args or ["--help"])

    def list_commands(self, ctx: Any) -> list[str]:
        known = list(COMMANDS)  # typer lists groups behind commands
        return sorted(
            super().list_commands(ctx), key=lambda name: known.index(name) if name in known else -1
        )

    def get_help_option(self, ctx: Any) -> Any:
        option = super().get_help_option(ctx)
        if option is not None:
            option.default = False
        return option


def command_module(name: str) -> str:
    """Return the module that holds a command."""
    return f"benchtool.commands.{COMMANDS[name][0].partition(':')[0]}"


def _show_version(wanted: bool) -> None:
    if wanted:
        print(f"benchtool {__version__}")
        raise typer.Exit


def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    """Take the options that stand before any command."""


def _unloaded() -> None:
    """Stand in for a command that was not requested."""


def _describe_misuse(error: typer.TyperException, words: Sequence[str]) -> str:
    """Join what typer says about wrong words into one sentence with the value and a next step."""
    problem = " ".join(error.format_message().split()).rstrip(".?")
    details = getattr(error.__cause__, "errors", None)  # a ValidationError holds what was given
    given = f" (given: {details()[0]['input']!r})" if callable(details) else ""
    context = getattr(error, "ctx", None)
    if context is not None:
        return f"{problem}{given}; see {context.command_path} --help"
    # The parser of words knows neither the command nor what an option without a value takes.
    named = [word for word in words if not word.startswith("-")]
    known = [one for one in COMMANDS if one.split() == named[: one.count(" ") + 1]]
    name = max(known, key=len, default="")
    option = getattr(error, "option_name", "")
    if "requires an argument" in problem and COMMANDS.get(name, ("",))[0]:
        called = getattr(import_module(command_module(name)), COMMANDS[name][0].partition(":")[2])
        about = [
            option_help(one).rstrip(".") for one in items(called.inputs) if one.option == option
        ]
        problem = f"{option} needs a value{''.join(f' ({one})' for one in about)}"
    return f"{problem}; see {' '.join(['benchtool', *name.split()])} --help"


def _describe_fault(error: Exception) -> str:
    """Keep the traceback of a fault of our own in a file and say where it is."""
    import tempfile
    import traceback

    try:
        handle, path = tempfile.mkstemp(prefix="benchtool-fault-", suffix=".txt", text=True)
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(f"benchtool {__version__}, python {sys.version}\n{sys.argv}\n")
            traceback.print_exception(error, file=file)
    except OSError:
        path = "these words"
    summary = " ".join(str(error).split())
    return (
        f"a fault in benchtool itself, {type(error).__name__}: {summary}; please report it with "
        f"{path}, or run again with BENCHTOOL_DEBUG=1 to see the traceback"
    )
