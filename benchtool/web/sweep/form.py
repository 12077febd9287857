"""The plan as a form: the options of `benchtool sweep`, by the same names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from nicegui import events, ui

from benchtool.acquire.air import Air
from benchtool.acquire.plan import Plan, plan_from_toml
from benchtool.acquire.sweep_options import air_of, with_options
from benchtool.errors import FileFormatError, InputError
from benchtool.web.tell import tells_errors

LARGEST_BYTES = 100_000
"""A plan file that is longer is none."""


@dataclass(frozen=True, slots=True)
class Field:
    """Describe one option: name, label, hint, and the type of its value."""

    name: str
    label: str
    hint: str
    kind: type = str


FIELDS: tuple[Field, ...] = (
    Field("z_over_r", "Plate distances, z/R", "0.5,1,2,4"),
    Field("pwm", "Pulses, us", "1400,1600"),
    Field("repeats", "Repeats", "9 for one rotor, 5 for several", int),
    Field("rotors", "Rotors that turn", "all, or 1,2"),
    Field("tilt", "Tilts, deg", "0"),
    Field("lateral", "Lateral positions, m", "0"),
    Field("sample_s", "Samples of a point, s", "2", float),
    Field("anchor_every", "Anchor after so many visits", "20; 0 for never", int),
    Field("seed", "Seed of the order", "0", int),
    Field("name", "Name of the run", "sweep"),
)

SURROUNDINGS: tuple[Field, ...] = (
    Field("operator", "Operator", "you"),
    Field("temperature", "Air, degC", "15 assumed", float),
    Field("pressure", "Pressure here, hPa", "1013.25 assumed", float),
    Field("humidity", "Humidity, %", "0 assumed", float),
    Field("calibration", "Calibration", "the device's latest, or none"),
    Field("stage", "Plate moved by", "device, hand, grbl:PORT"),
)

ORDERS = {
    "": "randomised",
    "counterbalanced": "counterbalanced",
    "as_given": "as given",
}


class PlanForm:
    """Hold what the operator typed.

    Args:
        changed: called after every change.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._base = Plan()
        self._file = ""
        self._inputs: dict[str, ui.input] = {}
        ui.label("What is left empty is filled in from the rig.").classes("soft")
        with ui.element("div").classes("field-grid"):
            for field in FIELDS:
                self._make(field)
            self._order = ui.select(ORDERS, value="", label="Order", on_change=changed)
            self._order.mark("order")
        more = ui.expansion("Air, operator, calibration, stage").classes("w-full").props("dense")
        with more, ui.element("div").classes("field-grid"):
            for field in SURROUNDINGS:
                self._make(field)
        with ui.row().classes("items-center"):
            upload = ui.upload(
                label="Plan file (TOML)",
                auto_upload=True,
                max_file_size=LARGEST_BYTES,
                on_upload=self._load,
            )
            upload.props("accept=.toml flat bordered dense").classes("w-72")
            self._loaded = ui.label().classes("soft")

    def plan(self) -> Plan:
        """Return the plan, not resolved.

        Raises:
            InputError: something typed cannot be read.
        """
        return with_options(self._base, {**self._given(FIELDS), "order": self._order.value or None})

    def air(self) -> Air:
        """Return the air that was typed."""
        given = self._given(SURROUNDINGS)
        return air_of(given["temperature"], given["pressure"], given["humidity"])

    def text(self, name: str) -> str | None:
        """Return what was typed in one field, None when nothing was."""
        return self._inputs[name].value.strip() or None

    def words(self) -> Sequence[str]:
        """Return the options of the command line."""
        words = ["--plan", self._file] if self._file else []
        for name, typed in self._inputs.items():
            if typed.value.strip():
                words += [f"--{name.replace('_', '-')}", typed.value.strip()]
        return [*words, *(["--order", self._order.value] if self._order.value else [])]

    def _make(self, field: Field) -> None:
        made = ui.input(field.label, placeholder=field.hint, on_change=self._changed)
        made.props("dense stack-label debounce=300").mark(field.name)
        self._inputs[field.name] = made

    def _given(self, fields: Sequence[Field]) -> dict[str, Any]:
        return {field.name: self._value(field) for field in fields}

    def _value(self, field: Field) -> Any:
        typed = self._inputs[field.name].value.strip()
        if not typed:
            return None
        try:
            return field.kind(typed)
        except ValueError:
            wanted = "a whole number" if field.kind is int else "a number"
            raise InputError(f"{field.label} is {typed!r}; type {wanted}") from None

    @tells_errors
    async def _load(self, event: events.UploadEventArguments) -> None:
        name = event.file.name
        try:
            text = (await event.file.read()).decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise FileFormatError(name, f"it cannot be read as text ({error})") from error
        self._base, self._file = plan_from_toml(text, name), name
        self._loaded.set_text(f"{name} is the base; what is typed above goes over it")
        self._changed()
