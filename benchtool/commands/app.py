"""Entry point of the command line: table of commands, error handling, exit codes.

Only the module of the requested command is imported; for the others the help shows their line in
`COMMANDS`. A module with a special argument syntax defines a ``Parser``.
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
from benchtool.commands.terminal.messages import (
    EscapedStream,
    find_cause,
    flush_output,
    print_error,
)
from benchtool.core.errors import (
    BenchtoolError,
    DataWarning,
    InputError,
    UnknownChoice,
    show_warning,
)

COMMANDS: dict[str, tuple[str, str]] = {  # by name, in the order of the help:
    # "module:function" in this package ("" for a group), and the first line of its docstring
    "ports": ("ports:ports", "List serial ports and diagnose connection problems"),
    "bench": ("", "Check a bench, map its motors, or serve a virtual bench"),
    "bench check": ("bench:check",
        "Check standstill, ESC arming, channel map, thrust sign and rpm at low throttle"),
    "bench map": ("bench:map_motors",
        "Turn each motor of a flight controller at low throttle and write the motor map"),
    "bench serve": ("bench:serve",
        "Serve a virtual bench on a pseudo-terminal, TCP port or MAVLink until Ctrl-C"),
    "firmware": ("firmware:firmware", "Generate bench firmware for an Arduino"),
    "calibrate": ("calibrate:calibrate", "Calibrate a load cell, or apply a calibration to a run"),
    "stop": ("sweep:stop", "Stop the motors of every bench that this user runs"),
    "sweep": ("sweep:sweep", "Sweep plate distance and throttle"),
    "record": ("sweep:record", "Record a pitch experiment"),
    "import": ("import_file:import_", "Import flight logs and files of other test stands"),
    "runs": ("", "List, query, tag, merge, close and verify runs"),
    "runs list": ("runs:list_", "List runs, fits and recordings"),
    "runs search": ("runs:search", "Search runs by name, rig, date, tags and notes"),
    "runs query": ("runs:query", "Query points, samples and fits with SQL (DuckDB)"),
    "runs show": ("runs:show", "Show the catalogue entries of runs and fits"),
    "runs compare": ("runs:compare", "Compare runs: metadata, and T_IGE/T_OGE by z/R"),
    "runs tag": ("runs:tag", "Add, remove or show tags of runs and fits"),
    "runs note": ("runs:note", "Add a note with date and author to a run or fit"),
    "runs verify": ("runs:verify", "Verify the file hashes of runs; exit code 2 on a mismatch"),
    "runs export": ("runs:export",
        "Export samples, points or settings of a run as MCAP, Parquet or CSV"),
    "runs merge": ("runs:merge", "Merge runs of one rig and propeller into a new run folder"),
    "runs close": ("runs:close", "Repair interrupted runs and write their tables; can be repeated"),
    "fit": ("fit:fit", "Fit a ground-effect model to runs or CSV files"),
    "motor": ("motor:motor", "Fit thrust curve and motor constants to runs without a plate"),
    "pool": ("fit:pool", "Combine fits of several rigs in a hierarchical model"),
    "explain": ("explain:explain", "Identify effects that a model lacks"),
    "report": ("report:report", "Write an HTML report of a run, fit or recording"),
    "simulate": ("", "Simulate pitch benches and flights in closed loop"),
    "simulate pitch": ("simulate:pitch", "Simulate a pitch bench with each controller"),
    "simulate flight": ("simulate:flight",
        "Simulate flights over an obstacle with each controller"),
    "export": ("motor:export", "Export a model for simulators, autopilots and firmware"),
    "demo": ("demo:demo", "Sweep a virtual bench, fit and write a report"),
    "library": ("", "List or show rigs, propellers, models and effects"),
    "library rigs": ("library_commands:rigs", "List rigs, or show one with all values and sources"),
    "library rigs new": ("library_commands:new_rig",
        "Create a rig file, with prompts for missing values"),
    "library propellers": ("library_commands:propellers",
        "List propellers, or show one with all values and sources"),
    "library models": ("library_commands:models",
        "List models, or show one with its effects and parameters"),
    "library effects": ("library_commands:effects",
        "List physical effects, or show one with law and parameters"),
    "web": ("web:web", "Start the browser interface"),
}  # fmt: skip

HEADINGS = {  # of `benchtool --help`, by the first command of a section
    "ports": "Set up a bench", "stop": "Measure", "fit": "Analyse", "simulate": "Use a model",
    "demo": "Other",
}  # fmt: skip

HELP = "Control rotor test benches near surfaces and fit ground-effect models."
EPILOG = """
Run `benchtool COMMAND --help` for the options of a command.
Run `benchtool --install-completion` to enable tab completion.
"""

_PATH_ERRORS = {  # system errors of an invalid path in any argument
    *(errno.ENOENT, errno.ENAMETOOLONG, errno.ENOTDIR, errno.EISDIR, errno.EEXIST, errno.ELOOP)
}

COMPLETION_VARIABLE = "_BENCHTOOL_COMPLETE"  # set by the completion script of a shell
UNEXPECTED_ERROR_CODE = 70  # exit code of an internal error (EX_SOFTWARE, BSD sysexits.h)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit the process with its exit code."""
    argument_list = list(sys.argv[1:] if arguments is None else arguments)
    if COMPLETION_VARIABLE in os.environ:
        line = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS", "")
        argument_list = _find_command(line.split()[1:]).split()
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "1")  # a search takes pydantic 0.02 s
    for stream in (sys.stdout, sys.stderr):
        # Characters that the console cannot encode are replaced, without a traceback.
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
        _run(argument_list)


def _run(arguments: list[str]) -> None:
    """Run one command and exit the process with its exit code."""
    try:
        _check_text(arguments)
        code = build_app(arguments)(args=arguments, prog_name="benchtool", standalone_mode=False)
        flush_output()
        sys.exit(code if isinstance(code, int) else 0)
    except typer.TyperException as error:
        print_error(_describe_usage_error(error, arguments))
        sys.exit(error.exit_code)
    except typer.Abort:
        print_error("aborted; no answer was given")
        sys.exit(1)
    except BenchtoolError as error:
        print_error(str(error))
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        sys.exit(130)
    except Exception as error:
        if os.environ.get("BENCHTOOL_DEBUG"):
            raise
        if isinstance(error, OSError) and error.errno in _PATH_ERRORS and error.filename:
            reason = (error.strerror or "cannot be used").lower()
            from benchtool.core.user_file import display_path

            print_error(f"{display_path(error.filename)}: {reason}; use another path")
            sys.exit(InputError.exit_code)
        if (cause := find_cause(error)) is not None:
            print_error(str(cause))
            sys.exit(cause.exit_code)
        print_error(_report_internal_error(error))
        sys.exit(UNEXPECTED_ERROR_CODE)


def _find_command(arguments: Sequence[str]) -> str:
    """Return the command that the arguments begin with, options skipped; "" for none."""
    positional = [argument for argument in arguments if not argument.startswith("-")]
    names = (" ".join(positional[:depth]) for depth in (3, 2, 1))
    return next((name for name in names if name in COMMANDS), "")


def _check_text(arguments: Sequence[str]) -> None:
    """Raise InputError for an argument that is not UTF-8: it cannot be stored or printed."""
    for argument in arguments:
        try:
            argument.encode()
        except UnicodeEncodeError:
            text = argument[:60].encode("ascii", "backslashreplace").decode()
            raise InputError(f"argument {text} is not UTF-8 text; use UTF-8") from None


def build_app(arguments: Sequence[str]) -> typer.Typer:
    """Return the application for one call; imports at most one command."""
    is_completion_setup = arguments[:1] in (["--install-completion"], ["--show-completion"])
    app = typer.Typer(
        cls=_Group,
        help=HELP,
        # Completion options are added only on request: they import pydantic.
        add_completion=is_completion_setup or COMPLETION_VARIABLE in os.environ,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
    )
    app.callback()(_options)
    positional = [argument for argument in arguments if not argument.startswith("-")]
    if positional and not is_completion_setup and positional[0] not in COMMANDS:
        names = [name for name in COMMANDS if " " not in name]
        raise UnknownChoice("command", positional[0], names)
    requested = "" if is_completion_setup else _find_command(arguments)
    words = requested.split()
    # Only a group lists its other commands; they take as long as the requested one.
    is_alone = bool(words and COMMANDS[requested][0] and [*arguments[: len(words)]] == words)
    groups: dict[str, typer.Typer] = {"": app}
    for name, (location, line) in COMMANDS.items():
        parent, _, last = name.rpartition(" ")
        if parent not in groups:
            continue  # the parent is a command, or not requested
        if not f"{requested} ".startswith(f"{name} "):
            if is_alone:
                continue
            groups[parent].command(last, help=line)(_unloaded)
        elif location and name == requested:
            from benchtool.commands.input_commands import GroupedCommand, with_options

            module = import_module(command_module(name))
            function = getattr(module, location.partition(":")[2])
            command_class = getattr(module, "Parser", GroupedCommand)
            groups[parent].command(last, cls=command_class)(with_options(function))
        else:
            groups[name] = typer.Typer(cls=_Group, rich_markup_mode=None, add_completion=False)
            groups[name].callback()(_unloaded)
            groups[parent].add_typer(groups[name], name=last, cls=_Group, help=f"{line}.")
    return app


class _Group(TyperGroup):
    """Group of commands with help under headings, in the order of `COMMANDS`.

    Without arguments it prints its help. typer imports pydantic to convert the missing value of
    a help option; False needs no conversion.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        return super().parse_args(ctx, args or ["--help"])

    def list_commands(self, ctx: Any) -> list[str]:
        names = super().list_commands(ctx)  # typer lists groups after commands
        order = list(COMMANDS)
        path = ctx.command_path.split()[1:]
        return sorted(names, key=lambda name: order.index(" ".join([*path, name])))

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        is_root = ctx.parent is None
        sections: dict[str, list[tuple[str, str]]] = {}
        heading, names = "Commands", self.list_commands(ctx)
        width = max(map(len, names), default=0)
        for name in names:
            heading = HEADINGS.get(name, heading) if is_root else heading
            text = self.commands[name].get_short_help_str(formatter.width)
            sections.setdefault(heading, []).append((name.ljust(width), text))
        for heading, rows in sections.items():
            with formatter.section(heading):
                formatter.write_dl(rows)
        if is_root:
            formatter.write(EPILOG)

    def get_help_option(self, ctx: Any) -> Any:
        option = super().get_help_option(ctx)
        if option is not None:
            option.default = False
        return option


def command_module(name: str) -> str:
    """Return the module of a command."""
    return f"benchtool.commands.{COMMANDS[name][0].partition(':')[0]}"


def _show_version(is_requested: bool) -> None:
    if is_requested:
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
    """Define the global options."""


def _unloaded() -> None:
    """Do nothing; placeholder for a command that is not loaded."""


def _describe_usage_error(error: typer.TyperException, arguments: Sequence[str]) -> str:
    """Return the message of a typer error as one sentence with the value and the help command."""
    problem = " ".join(error.format_message().split()).rstrip(".?")
    context = getattr(error, "ctx", None)
    if context is not None:
        return f"{problem}; see {context.command_path} --help"
    # typer's parser reports neither the command nor what an option without a value takes.
    name = _find_command(arguments)
    option = getattr(error, "option_name", "")
    if "requires an argument" in problem and COMMANDS.get(name, ("",))[0]:
        from benchtool.commands.input_commands import option_help
        from benchtool.core.inputs import items

        function = getattr(import_module(command_module(name)), COMMANDS[name][0].partition(":")[2])
        fields = [item for item in items(function.inputs) if item.option == option]
        texts = [option_help(item).rstrip(".") for item in fields]
        problem = f"{option} needs a value{''.join(f' ({text})' for text in texts)}"
    return f"{problem}; see {' '.join(['benchtool', *name.split()])} --help"


def _report_internal_error(error: Exception) -> str:
    """Write the traceback of an internal error to a file and return the message."""
    import tempfile
    import traceback

    try:
        handle, path = tempfile.mkstemp(prefix="benchtool-fault-", suffix=".txt", text=True)
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(f"benchtool {__version__}, python {sys.version}\n{sys.argv}\n")
            traceback.print_exception(error, file=file)
    except OSError:
        path = "this message"
    summary = " ".join(str(error).split())
    return (
        f"internal error, {type(error).__name__}: {summary}; please report it with "
        f"{path}, or run again with BENCHTOOL_DEBUG=1 to see the traceback"
    )
