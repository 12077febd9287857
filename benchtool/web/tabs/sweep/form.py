"""The plan as a form: the options of `benchtool sweep`, by the same names."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from nicegui import events, ui

from benchtool.acquire.air import Air
from benchtool.acquire.inputs import AirInputs, SweepInputs
from benchtool.acquire.plan import Plan, plan_from_toml
from benchtool.core.input_text import text_of
from benchtool.core.inputs import Item, items, make, words
from benchtool.core.inputs import values_of as values_by_name
from benchtool.core.rig import Rig
from benchtool.errors import FileFormatError
from benchtool.web.notifications import shows_errors

LARGEST_BYTES = 100_000
"""A plan file that is longer is none."""


FIELDS = tuple(item for item in items(Plan) if not item.choices)
CHOICES = tuple(item for item in items(Plan) if item.choices)
AIR = items(AirInputs)
SURROUNDINGS = (
    *(item for item in items(SweepInputs) if item.name == "operator"),
    *AIR,
    *(item for item in items(SweepInputs) if item.name in ("calibration", "stage")),
)


def values_of(plan: Plan, rig: Rig) -> dict[str, str]:
    """Return what a plan runs with, by the names of the fields, as it would be typed.

    Args:
        plan: resolved.
        rig: that it was resolved for.
    """
    ratios = [distance_m / rig.propulsion.radius_m for distance_m in plan.plate.distances_m]
    given = values_by_name(plan) | {"z_over_r": tuple(ratios)}
    return {
        item.name: ",".join(f"{each:g}" for each in value) if item.many else text_of(value)
        for item in FIELDS
        if item.name != "z_m" and (value := given[item.name]) is not None
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
        self._inputs: dict[str, ui.input | ui.select] = {}
        ui.label("A field that is left empty says what runs instead.").classes("soft")
        with ui.element("div").classes("field-grid"):
            for item in FIELDS:
                self._make(item)
            for item in CHOICES:
                options = {"": item.default} | {
                    each: each for each in item.choices if each != item.default
                }
                chosen = ui.select(options, value="", label=item.label, on_change=changed)
                self._inputs[item.name] = chosen.mark(item.name)
        more = ui.expansion("Air, operator, calibration, stage").classes("w-full").props("dense")
        with more, ui.element("div").classes("field-grid"):
            for item in SURROUNDINGS:
                self._make(item)
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
        given = {item.name: self.text(item.name) for item in (*FIELDS, *CHOICES)}
        return make(Plan, given, source="label", base=self._base)

    def show_values(self, plan: Plan, rig: Rig) -> None:
        """Say in empty fields what a resolved plan runs with."""
        for name, text in values_of(plan, rig).items():
            made, said = self._inputs[name], f"empty: {text}"
            if made.props["placeholder"] != said:
                made.props["placeholder"] = said
                made.update()

    def air(self) -> Air:
        """Return the air that was typed."""
        given = {item.name: self.text(item.name) for item in AIR}
        return make(AirInputs, given, source="label").air()

    def text(self, name: str) -> str | None:
        """Return what was typed in one field, None when nothing was."""
        return self._inputs[name].value.strip() or None

    def words(self) -> Sequence[str]:
        """Return the options of the command line."""
        given = {name: typed.value.strip() for name, typed in self._inputs.items()}
        return words(SweepInputs, given | {"plan": self._file})

    def _make(self, item: Item) -> None:
        empty = item.about.empty or text_of(item.default) or "from the rig"
        made = ui.input(item.label, placeholder=f"empty: {empty}", on_change=self._changed)
        made.props("dense stack-label debounce=300").mark(item.name)
        self._inputs[item.name] = made

    @shows_errors
    async def _load(self, event: events.UploadEventArguments) -> None:
        name = event.file.name
        try:
            text = (await event.file.read()).decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise FileFormatError(name, f"it cannot be read as text ({error})") from error
        self._base, self._file = plan_from_toml(text, name), name
        self._loaded.set_text(f"{name} is the base; what is typed above goes over it")
        self._changed()
