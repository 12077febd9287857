"""typer commands from input dataclasses, one option per field."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from typer.core import TyperCommand

from benchtool.core.inputs import Input, InputField, Inputs, build_inputs, items
from benchtool.core.text import format_value

T = TypeVar("T", bound=Inputs)

Verbose = Annotated[bool, Input("Print all details.", group="Terminal")]


def command_from_inputs(
    cls: type[T], base: Callable[[dict[str, Any]], T] | None = None
) -> Callable[[Callable[[T], None]], Callable[..., None]]:
    """Return a decorator that turns a function of inputs into a typer command.

    Args:
        cls: options of the command; the docstring of the decorated function is its help.
        base: returns the values of options that are not given, in place of the defaults. Called
            with the given values by name, which it may change.
    """

    def decorated(run: Callable[[T], None]) -> Callable[..., None]:
        def command(**typed: Any) -> None:
            fields = _fields(cls)
            values = {
                fields[key].name: Path(value) if fields[key].kind is Path and isinstance(value, str)
                else value
                for key, value in typed.items() if value not in (None, [])
            }  # fmt: skip
            run(build_inputs(cls, values, source="option", base=base and base(values)))

        command.__doc__ = run.__doc__
        command.inputs = cls  # type: ignore[attr-defined]
        command.has_base = base is not None  # type: ignore[attr-defined]
        return command

    return decorated


def _fields(cls: type[Inputs]) -> dict[str, InputField]:
    """Return the inputs of a command by parameter name."""
    return {item.key.replace(".", "_"): item for item in items(cls)}


def with_options(command: Any) -> Any:
    """Return a command with the signature that typer reads; built for the requested one only."""
    parameters = [
        _parameter(name, item, item.required and not command.has_base)
        for name, item in _fields(command.inputs).items()
    ]
    command.__signature__ = inspect.Signature(parameters)
    command.__annotations__ = {item.name: item.annotation for item in parameters}
    return command


def _parameter(name: str, item: InputField, required: bool) -> inspect.Parameter:
    """Return the parameter of one input; None means the option was not given."""
    # A number may have a unit: InputField.read parses it, not typer.
    numeric = not item.is_sequence and item.kind in (int, float)
    kind: Any = str if item.is_sequence or numeric else item.kind
    if item.kind is Mapping or (item.is_sequence and item.kind in (str, Path)):
        kind = list[str]
    options: dict[str, Any] = {"help": option_help(item), "show_default": False}

    def find_choices(incomplete: str) -> list[str]:
        return [choice for choice in item.choices if choice.startswith(incomplete)]

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
            autocompletion=find_choices if item.choices else None,
            **options,
        )
    return inspect.Parameter(
        name,
        inspect.Parameter.KEYWORD_ONLY,
        default=inspect.Parameter.empty if required else None,
        annotation=Annotated[kind if required else kind | None, option],
    )


class _Text:
    """Converter that leaves texts as they are; `InputField.read` checks them."""

    def coerce(self, value: Any, param: Any, **_: Any) -> Any:
        is_multiple = param.multiple or param.nargs == -1
        if value is None:
            return () if is_multiple else None
        return list(value) if is_multiple else value


class GroupedCommand(TyperCommand):
    """Command whose help lists options under headings, in the order of their first options."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        for parameter in self.get_params(ctx):
            # typer's converters import pydantic, 0.1 s.
            parameter.get_runtime_param = _Text  # type: ignore[attr-defined]
        return super().parse_args(ctx, args)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        sections: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is None:
                continue
            default = "Arguments" if parameter.param_type_name == "argument" else "Options"
            heading = getattr(parameter, "rich_help_panel", None) or default
            sections.setdefault(heading, []).append(record)
        for heading, records in sections.items():
            if records:
                with formatter.section(heading):
                    formatter.write_dl(records)


def option_help(item: InputField) -> str:
    """Return the help of an input: sentence, range with unit or choices, and default."""
    metadata = item.metadata
    notes = [f"{item.range} {metadata.unit}".strip(), ", ".join(item.choices)]
    default = "" if item.required or item.kind is bool else format_value(item.default)
    if metadata.default_text or default:
        notes.append(f"default: {metadata.default_text or default}")
    details = "; ".join(filter(None, notes))
    return f"{metadata.help} [{details}]" if details else metadata.help
