"""The inputs of `benchtool sweep` as a form, a plan file as its base."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import events, ui

from benchtool.acquire.air import Air
from benchtool.acquire.inputs import SweepInputs
from benchtool.acquire.plan import Plan, plan_from_toml
from benchtool.core.errors import FileFormatError
from benchtool.core.input_text import text_of
from benchtool.core.inputs import items, values_of
from benchtool.core.rig import Rig
from benchtool.web.form import InputForm
from benchtool.web.notifications import shows_errors

LARGEST_BYTES = 100_000
"""A plan file that is longer is none."""


FIRST = (
    "z_over_r", "pwm", "repeats", "rotors", "tilt", "lateral", "sample_s", "anchor_every", "seed",
    "order", "name",
)  # fmt: skip
"""Inputs of a plan that are always shown; the others can be opened."""

FIELDS = tuple(item.name for item in items(Plan))
AIR = tuple(item.name for item in items(Air))


class PlanForm:
    """Hold the inputs of a sweep.

    Args:
        changed: called after every change.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._base, self._file = SweepInputs(), ""
        self._form = InputForm(SweepInputs, changed)
        ui.label("A field that is left empty shows what runs instead.").classes("soft")
        with ui.element("div").classes("field-grid"):
            self._form.add(*FIRST)
        more = ui.expansion("Air, operator, calibration, stage, more of the plan")
        more.classes("w-full").props("dense")
        with more, ui.element("div").classes("field-grid"):
            self._form.add("operator", *AIR, "calibration", "stage")
            self._form.add(*(name for name in FIELDS if name not in FIRST))
        with ui.row().classes("items-center"):
            upload = ui.upload(
                label="Plan file (TOML)",
                auto_upload=True,
                max_file_size=LARGEST_BYTES,
                on_upload=self._load,
            )
            upload.props("accept=.toml flat bordered dense").classes("w-72")
            self._loaded = ui.label().classes("soft")

    def inputs(self) -> SweepInputs:
        """Return what is typed, its plan not resolved.

        Raises:
            InputError: something typed cannot be read, or is out of range.
        """
        return self._form.make(self._base)

    def show_values(self, plan: Plan, rig: Rig) -> None:
        """Show in empty fields what a resolved plan runs with."""
        self._form.show_empty(plan_texts(plan, rig))

    def words(self) -> list[str]:
        """Return the options of the command line."""
        return self._form.words({"plan": self._file})

    @shows_errors
    async def _load(self, event: events.UploadEventArguments) -> None:
        name = event.file.name
        try:
            text = (await event.file.read()).decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise FileFormatError(name, f"it cannot be read as text ({error})") from error
        self._base, self._file = SweepInputs(plan=plan_from_toml(text, name)), name
        self._loaded.set_text(f"{name} is the base; what is typed above replaces parts of it")
        self._changed()


def plan_texts(plan: Plan, rig: Rig) -> dict[str, str]:
    """Return what a plan runs with, by the names of the fields, as it would be typed.

    Args:
        plan: resolved.
        rig: that it was resolved for.
    """
    ratios = tuple(distance_m / rig.propulsion.radius_m for distance_m in plan.plate.distances_m)
    values = values_of(plan) | {"z_over_r": ratios}
    return {
        item.name: ",".join(f"{each:g}" for each in value) if item.many else text_of(value)
        for item in items(Plan)
        if not item.choices and item.name != "z_m" and (value := values[item.name]) is not None
    }
