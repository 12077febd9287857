"""Card to edit and preview a plan, start it, or resume a stopped run."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import replace

from nicegui import events, ui

from benchtool.acquire import visit_order
from benchtool.acquire.check_plan import PlanExtremes, check_plan
from benchtool.acquire.inputs import SweepInputs
from benchtool.acquire.operator import arming_prompt
from benchtool.acquire.plan import THROTTLE_TESTS, Plan, PlatePart, plan_from_toml, read_plan
from benchtool.acquire.visit_order import Visit
from benchtool.core.air import Air
from benchtool.core.errors import BenchtoolError, FileFormatError, InputError
from benchtool.core.inputs import input_values, items
from benchtool.core.rig import Rig
from benchtool.core.text import format_value
from benchtool.data.catalogue.index import load_entries
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.web import widgets
from benchtool.web.context import PageContext
from benchtool.web.form import InputForm

MAX_PREVIEW_ROWS = 400  # assumed
COLUMNS = ("point", "kind", "z/R", "us", "repeat")
MAX_PLAN_BYTES = 100_000  # larger files are rejected; assumed

MAIN_FIELDS = (  # inputs of a plan that are always visible
    "z_over_r", "pwm", "repeats", "rotors", "tilt", "lateral", "sample_s", "anchor_every", "seed",
    "order", "name",
)  # fmt: skip

FIELDS = tuple(item.name for item in items(Plan))
PLATE_FIELDS = (*(item.name for item in items(PlatePart)), "anchor_every")  # inputs of a plate
AIR = tuple(item.name for item in items(Air))
STOPPED = ("sweep", "stopped")  # kind and state of an entry that can be resumed


def plan_facts(
    plan: Plan, rig: Rig, visits: Sequence[Visit], expected: PlanExtremes
) -> dict[str, str]:
    """Return the summary of a resolved plan."""
    kinds = [visit.kind for visit in visits]
    extra = f", {kinds.count('reference')} references, {kinds.count('anchor')} anchors"
    extra = extra if plan.plate.used else ""
    duration_s = visit_order.expected_duration_s(plan, rig, visits)
    return {
        "points": (
            f"{len(visits)}, of {len(visit_order.plan_settings(plan, rig))} settings: "
            f"{plan.repeats} repeats{extra}"
        ),
        "duration": f"about {visit_order.format_duration(duration_s)}",
        "expected maxima": (
            f"{expected.pwm_us:g} us, about {expected.rpm:.0f} rpm and "
            f"{expected.thrust_N:.1f} N of {rig.limits.thrust_N:g} N"
        ),
    }


def plan_rows(plan: Plan, rig: Rig, visits: Sequence[Visit]) -> list[dict[str, str]]:
    """Return the points in order, with keys COLUMNS."""
    rows = []
    for visit in visits[:MAX_PREVIEW_ROWS]:
        kind, z_text = "throttle", "–"
        if plan.plate.used:
            z_over_R = visit.target_z_m / rig.propulsion.radius_m
            kind, z_text = visit.kind, "parked" if visit.is_parked else f"{z_over_R:.2f}"
        row = (str(visit.point), kind, z_text, f"{visit.level_us:g}", str(visit.repeat))
        rows.append(dict(zip(COLUMNS, row, strict=True)))
    return rows


def plan_texts(plan: Plan, rig: Rig) -> dict[str, str]:
    """Return the values of a resolved plan by field, in input notation."""
    z_over_R = tuple(z_m / rig.propulsion.radius_m for z_m in plan.plate.distances_m)
    values = input_values(plan) | {"z_over_r": z_over_R}
    return {
        item.name: ",".join(f"{number:g}" for number in value)
        if item.is_sequence
        else format_value(value)
        for item in items(Plan)
        if item.name not in ("z_m", "throttle") and (value := values[item.name]) is not None
    }


class PlanCard:
    """Plan with preview, start and resume."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._session: tuple[int, str] = (-1, "")
        self._arming_text = ""  # of a valid plan
        self._base, self._file = SweepInputs(), ""
        self._form = InputForm(SweepInputs, self._update)
        with widgets.titled_card("Plan") as self._card:
            self._build_form()
            self._facts = ui.element("div").classes("facts-grid")
            self._problem = ui.label().classes("warn-box w-full")
            with ui.expansion("Order of points").classes("w-full").props("dense"):
                columns = [
                    {"name": name, "label": name, "field": name, "align": "right"}
                    for name in COLUMNS
                ]
                self._order = ui.table(rows=[], columns=columns, row_key="point", pagination=12)
                self._order.props("dense flat")
            with ui.row().classes("items-center w-full"):
                self._start = ui.button("Start the sweep", icon="play_arrow", on_click=self._arm)
                self._resume = ui.button("Resume a stopped run", on_click=self._select_run)
                self._resume.props("outline")
                self._closing = ui.label("closing the run ...").classes("soft").props("role=status")
            self._command = widgets.CommandRow()

    def _build_form(self) -> None:
        ui.label("Empty fields show their default.").classes("soft")
        with ui.element("div").classes("field-grid"):
            self._form.add(*MAIN_FIELDS)
        options = ui.expansion("Air, operator, calibration, stage, other plan fields")
        options.classes("w-full").props("dense")
        with options, ui.element("div").classes("field-grid"):
            self._form.add("operator", *AIR, "calibration", "stage")
            self._form.add(*(name for name in FIELDS if name not in MAIN_FIELDS))
        with ui.row(wrap=False).classes("items-center w-full"):
            tests = {name: name for name in THROTTLE_TESTS}
            test = ui.select({"": "plate sweep"} | tests, value="", label="Test")
            test.props("dense").classes("w-44").on_value_change(self._select_test)
            upload = widgets.file_upload("Plan file (TOML)", max_file_size=MAX_PLAN_BYTES)
            upload.props("accept=.toml flat bordered dense").on_upload(self._load)
        self._base_hint = ui.label().classes("soft")

    def _select_test(self, event: events.ValueChangeEventArguments[str]) -> None:
        """Use a library plan without a plate as the base of the form."""
        name = str(event.value or "")
        plan = read_plan(name) if name else Plan()
        self._base, self._file = SweepInputs(plan=plan), name
        self._update()

    @widgets.show_errors
    async def _load(self, event: events.UploadEventArguments) -> None:
        name = event.file.name
        try:
            text = (await event.file.read()).decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise FileFormatError(name, f"the file is not UTF-8 text ({error})") from error
        self._base, self._file = SweepInputs(plan=plan_from_toml(text, name)), name
        self._base_hint.set_text(f"{name} is the base; fields above override its values")
        self._update()

    def refresh(self) -> None:
        connection = self._context.bench.connection
        if (connection.session, connection.status) != self._session:
            self._session = connection.session, connection.status
            self._update()
        is_idle = connection.status == "on" and not connection.is_weighing
        is_idle = is_idle and not self._context.bench.sweep.active
        self._start.set_enabled(is_idle and bool(self._arming_text))
        self._resume.set_enabled(is_idle)
        self._closing.set_visibility(self._context.bench.sweep.status == "closing")

    def _update(self) -> None:
        connection, runs = self._context.bench.connection, self._context.runs
        rig = connection.rig
        problem = self._arming_text = ""
        facts: dict[str, str] = {}
        rows: list[dict[str, str]] = []
        try:
            if rig is None:
                raise InputError("a plan needs the rig of a bench; connect a bench first")
            plan = self._form.make(self._base).plan.resolved(rig)
            self._form.show_defaults(plan_texts(plan, rig))
            self._form.show_fields(PLATE_FIELDS, plan.plate.used)
            limits = connection.identity.limits if connection.identity else None
            expected, visits = check_plan(plan, rig, limits), visit_order.plan_visits(plan, rig)
            facts = plan_facts(plan, rig, visits, expected)
            rows = plan_rows(plan, rig, visits)
            self._arming_text = arming_prompt(plan, rig, expected)
        except BenchtoolError as error:
            problem = str(error)
        self._problem.set_text(problem)
        self._problem.set_visibility(bool(problem))
        widgets.show_facts(self._facts, facts)
        self._order.rows = rows
        self._order.update()
        extra = {
            "address": connection.address or "ADDRESS",
            "plan": self._file,
            "rig": rig.name if rig and not connection.address.startswith("sim:") else None,
            "runs": None if runs == SweepInputs().runs else runs,
        }
        self._command.show(["sweep", *self._form.arguments(extra)])

    @widgets.show_errors
    def _arm(self) -> None:
        self._context.require_control()
        self._update()
        if not self._arming_text:
            raise InputError(self._problem.text)
        inputs = replace(self._form.make(self._base), runs=self._context.runs)
        widgets.confirm_arming(self._context, self._card, self._arming_text, inputs)

    @widgets.show_errors
    async def _select_run(self) -> None:
        self._context.require_control()
        entries = await asyncio.to_thread(load_entries, self._context.runs)
        names = [entry.name for entry in entries if (entry.kind, entry.state) == STOPPED]
        if not names:
            raise InputError(f"no stopped sweep in {self._context.runs}; start a new sweep")
        with widgets.open_dialog("Resume a run") as dialog:
            select = ui.select(names, value=names[0]).classes("w-full")

            @widgets.show_errors
            async def resume() -> None:
                path = RunsFolder(self._context.runs).find_path(select.value)
                await widgets.confirm_resume(self._context, self._card, path)
                dialog.close()

            with ui.row():
                ui.button("Resume", on_click=resume)
                ui.button("Cancel", on_click=dialog.close).props("outline")
