"""The plan as a form: the options of `benchtool sweep`, by the same names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from nicegui import events, ui

from benchtool.acquire.air import Air
from benchtool.acquire.plan import Plan, plan_from_toml
from benchtool.acquire.sweep_options import air_of, with_options
from benchtool.core.rig import Rig
from benchtool.errors import FileFormatError, InputError
from benchtool.web.tell import tells_errors

LARGEST_BYTES = 100_000
"""A plan file that is longer is none."""


@dataclass(frozen=True, slots=True)
class Field:
    """Describe one option.

    Attributes:
        name, label: of the option.
        empty: what runs when nothing is typed.
        kind: type of its value.
    """

    name: str
    label: str
    empty: str = "from the rig"
    kind: type = str


FIELDS: tuple[Field, ...] = (
    Field("z_over_r", "Plate distances, z/R"),
    Field("pwm", "Pulses, us"),
    Field("repeats", "Repeats", kind=int),
    Field("rotors", "Rotors that turn"),
    Field("tilt", "Tilts, deg"),
    Field("lateral", "Lateral positions, m"),
    Field("sample_s", "Samples of a point, s", kind=float),
    Field("anchor_every", "Anchor after so many visits (0: never)", kind=int),
    Field("seed", "Seed of the order", kind=int),
    Field("name", "Name of the run"),
)

SURROUNDINGS: tuple[Field, ...] = (
    Field("operator", "Operator", "not recorded"),
    Field("temperature", "Air, degC", f"{Air().temperature_degC:g} assumed", float),
    Field("pressure", "Pressure here, hPa", f"{1e-2 * Air().pressure_Pa:g} assumed", float),
    Field("humidity", "Humidity, %", f"{1e2 * Air().humidity:g} assumed", float),
    Field("calibration", "Calibration (ID or none)", "the device's latest"),
    Field("stage", "Plate moved by (device, hand, grbl:PORT)", "as device and rig say"),
)


def values_of(plan: Plan, rig: Rig) -> dict[str, str]:
    """Return what a plan runs with, by the names of the fields, as it would be typed.

    Args:
        plan: resolved.
        rig: that it was resolved for.
    """
    ratios = [distance_m / rig.propulsion.radius_m for distance_m in plan.plate.distances_m]
    lists = {
        "z_over_r": ratios,
        "pwm": plan.throttle.pwm_us,
        "rotors": plan.throttle.rotors_on,
        "tilt": plan.plate.tilts_deg,
        "lateral": plan.plate.lateral_m,
    }
    return {name: ",".join(f"{value:g}" for value in values) for name, values in lists.items()} | {
        "repeats": str(plan.repeats),
        "sample_s": f"{plan.sample_s:g}",
        "anchor_every": str(plan.order.anchor_every),
        "seed": str(plan.order.seed),
        "name": plan.name,
    }


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
        ui.label("A field that is left empty says what runs instead.").classes("soft")
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

    def show_values(self, plan: Plan, rig: Rig) -> None:
        """Say in empty fields what a resolved plan runs with."""
        for name, text in values_of(plan, rig).items():
            made, said = self._inputs[name], f"empty: {text}"
            if made.props["placeholder"] != said:
                made.props["placeholder"] = said
                made.update()

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
        made = ui.input(field.label, placeholder=f"empty: {field.empty}", on_change=self._changed)
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
