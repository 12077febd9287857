"""Make a command of a dataclass of inputs: typer reads its options off the fields."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from typer.core import TyperCommand

from benchtool.core.input_text import format_value
from benchtool.core.inputs import InputField, Inputs, build_inputs, items

T = TypeVar("T", bound=Inputs)


def command_from_inputs(
    cls: type[T], base: Callable[[dict[str, Any]], T] | None = None
) -> Callable[[Callable[[T], None]], Callable[..., None]]:
    """Make a function of inputs one that typer makes a command of.

    Args:
        cls: what the command takes; the docstring of the decorated function is its help.
        base: gives what values that were not given are taken from, in place of the defaults.
            It takes what was given, by name, and may change that.
    """
    known = {item.key.replace(".", "_"): item for item in items(cls)}
    parameters = [
        _parameter(name, item, item.required and base is None) for name, item in known.items()
    ]

    def decorated(run: Callable[[T], None]) -> Callable[..., None]:
        def command(**typed: Any) -> None:
            given = {
                known[key].name: value for key, value in typed.items() if value not in (None, [])
            }
            run(build_inputs(cls, given, source="option", base=base and base(given)))

        command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        command.__annotations__ = {each.name: each.annotation for each in parameters}
        command.__doc__ = run.__doc__
        command.inputs = cls  # type: ignore[attr-defined]
        return command

    return decorated


def _parameter(name: str, item: InputField, required: bool) -> inspect.Parameter:
    """Return the parameter of one input; None stands for what was not given."""
    # A number may carry a unit: the declaration reads it, not typer.
    numeric = not item.is_sequence and item.kind in (int, float)
    kind: Any = str if item.is_sequence or numeric else item.kind
    if item.kind is Mapping or (item.is_sequence and item.kind in (str, Path)):
        kind = list[str]
    options: dict[str, Any] = {"help": option_help(item), "show_default": False}
    if numeric:
        options["metavar"] = f"<{item.kind.__name__}>"
    if item.metadata.argument:
        option: Any = typer.Argument(metavar=item.metadata.argument, **options)
    elif item.kind is bool and item.default is True:
        both = f"{item.option}/{item.option.replace('--', '--no-', 1)}"
        option = typer.Option(both, rich_help_panel=item.group or None, **options)
    else:
        names = filter(None, (item.option, item.metadata.alias))
        option = typer.Option(
            *names,
            hidden=item.metadata.hidden,
            rich_help_panel=item.group or None,
            autocompletion=_completions(item.choices) if item.choices else None,
            **options,
        )
    return inspect.Parameter(
        name,
        inspect.Parameter.KEYWORD_ONLY,
        default=inspect.Parameter.empty if required else None,
        annotation=Annotated[kind if required else kind | None, option],
    )


def _completions(choices: Sequence[str]) -> Callable[[str], list[str]]:
    def beginning_with(incomplete: str) -> list[str]:
        return [choice for choice in choices if choice.startswith(incomplete)]

    return beginning_with


class GroupedCommand(TyperCommand):
    """A command whose help lists options under headings, in the order of their first options."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        sections: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is None:
                continue
            place = "Arguments" if parameter.param_type_name == "argument" else "Options"
            heading = getattr(parameter, "rich_help_panel", None) or place
            sections.setdefault(heading, []).append(record)
        for heading, records in sections.items():
            if records:
                with formatter.section(heading):
                    formatter.write_dl(records)


def option_help(item: InputField) -> str:
    """Return the help of an input: sentence, range with unit or choices, and default."""
    about = item.metadata
    notes = [f"{item.range} {about.unit}".strip(), ", ".join(item.choices)]
    usual = "" if item.required or item.kind is bool else format_value(item.default)
    if about.default_text or usual:
        notes.append(f"default: {about.default_text or usual}")
    noted = "; ".join(filter(None, notes))
    return f"{about.help} [{noted}]" if noted else about.help
