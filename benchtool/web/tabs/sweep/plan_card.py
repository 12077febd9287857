"""Edit a plan, see its preview, start it, or resume a run that was stopped."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from nicegui import events, run, ui

from benchtool.acquire.arming import arming_prompt
from benchtool.acquire.check_plan import check_plan
from benchtool.acquire.inputs import SweepInputs
from benchtool.acquire.plan import THROTTLE_TESTS, Plan, PlatePart, plan_from_toml, read_plan
from benchtool.acquire.visit_order import expected_duration_s, minutes, plan_settings, plan_visits
from benchtool.core.air import Air
from benchtool.core.errors import BenchtoolError, FileFormatError, InputError
from benchtool.core.input_text import format_value
from benchtool.core.inputs import input_values, items
from benchtool.core.rig import Rig
from benchtool.data.atomic import read_json
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.web.bench_process.messages import StartSweep
from benchtool.web.context import PageContext
from benchtool.web.form import InputForm
from benchtool.web.widgets import (
    CommandRow,
    confirm_arming,
    file_upload,
    open_dialog,
    show_errors,
    show_facts,
    titled_card,
)

SHOWN_VISITS = 400  # Rows of the order that are shown; a choice

COLUMNS = ("visit", "kind", "z/R", "us", "repeat")

MAX_BYTES = 100_000  # A plan file that is longer is none

FIRST = (
    "z_over_r", "pwm", "repeats", "rotors", "tilt", "lateral", "sample_s", "anchor_every", "seed",
    "order", "name",
)  # fmt: skip
"""Inputs of a plan that are always shown; the others can be opened."""

FIELDS = tuple(item.name for item in items(Plan))
PLATE_FIELDS = (*(item.name for item in items(PlatePart)), "anchor_every")  # inputs of a plate
AIR = tuple(item.name for item in items(Air))


class PlanPreview(NamedTuple):
    """Hold what is shown of a plan.

    Attributes:
        arming: what the operator must know before confirming.
        order: rows by the names of COLUMNS.
    """

    facts: Mapping[str, str]
    arming: str
    order: Sequence[dict[str, str]]


def build_preview(plan: Plan, rig: Rig, device_limits: Mapping[str, float] | None) -> PlanPreview:
    """Return the preview of a resolved plan.

    Raises:
        PlanError: the limits of rig or device do not allow it.
    """
    expected = check_plan(plan, rig, device_limits)
    visits = plan_visits(plan, rig)
    radius_m = rig.propulsion.radius_m
    kinds = [visit.kind for visit in visits]
    apart = f", {kinds.count('reference')} references, {kinds.count('anchor')} anchors"
    apart = apart if plan.plate.used else ""
    pulses = ", ".join(f"{pulse:g}" for pulse in plan.throttle.pwm_us)
    facts = {
        "rig": f"{rig.name}: {rig.title}",
        "plate z/R": ", ".join(f"{z_m / radius_m:g}" for z_m in plan.plate.distances_m)
        or "no plate: throttle alone",
        "pulses": f"{pulses} us",
        "visits": (
            f"{len(visits)}, of {len(plan_settings(plan, rig))} settings: "
            f"{plan.repeats} repeats{apart}"
        ),
        "duration": f"about {minutes(expected_duration_s(plan, rig, visits))}",
        "limits hold": (
            f"at most {expected.pwm_us:g} us, about {expected.rpm:.0f} rpm and "
            f"{expected.thrust_N:.1f} N of {rig.limits.thrust_N:g} N"
        ),
    }
    rows = []
    for visit in visits[:SHOWN_VISITS]:
        place, level = visit.setting.place, f"{visit.setting.level_us:g}"
        kind: str = visit.kind
        distance = f"{place.z_m / radius_m:.2f}"
        if not plan.plate.used:
            kind, distance = "throttle", "–"
        elif place.parked:
            distance = "parked"
        row = (str(visit.point), kind, distance, level, str(visit.repeat))
        rows.append(dict(zip(COLUMNS, row, strict=True)))
    return PlanPreview(facts, arming_prompt(plan, rig, expected), rows)


def plan_texts(plan: Plan, rig: Rig) -> dict[str, str]:
    """Return what a plan, resolved for a rig, runs with, by field, as it would be typed."""
    ratios = tuple(distance_m / rig.propulsion.radius_m for distance_m in plan.plate.distances_m)
    values = input_values(plan) | {"z_over_r": ratios}
    return {
        item.name: ",".join(f"{each:g}" for each in value)
        if item.is_sequence
        else format_value(value)
        for item in items(Plan)
        if item.name not in ("z_m", "throttle") and (value := values[item.name]) is not None
    }


class PlanCard:
    """Offer the plan and its start."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._session: tuple[int, str] = (-1, "")
        self._preview: PlanPreview | None = None
        self._base, self._file = SweepInputs(), ""
        self._form = InputForm(SweepInputs, self._look)
        with titled_card("Plan") as self._card:
            self._show_form()
            self._facts = ui.element("div").classes("facts-grid")
            self._problem = ui.label().classes("warn-box w-full")
            with ui.expansion("Order of the visits").classes("w-full").props("dense"):
                columns = [
                    {"name": name, "label": name, "field": name, "align": "right"}
                    for name in COLUMNS
                ]
                self._order = ui.table(rows=[], columns=columns, row_key="visit", pagination=12)
                self._order.props("dense flat")
            with ui.row().classes("items-center w-full"):
                self._start = ui.button("Start the sweep", icon="play_arrow", on_click=self._arm)
                self._resume = ui.button("Resume a stopped run", on_click=self._choose)
                self._resume.props("outline")
            self._command = CommandRow()
        self._look()

    def _show_form(self) -> None:
        ui.label("A field that is left empty shows what runs instead.").classes("soft")
        with ui.element("div").classes("field-grid"):
            self._form.add(*FIRST)
        more = ui.expansion("Air, operator, calibration, stage, more of the plan")
        more.classes("w-full").props("dense")
        with more, ui.element("div").classes("field-grid"):
            self._form.add("operator", *AIR, "calibration", "stage")
            self._form.add(*(name for name in FIELDS if name not in FIRST))
        with ui.row().classes("items-center"):
            tests = {name: name for name in THROTTLE_TESTS}
            ui.select(
                {"": "plate sweep"} | tests, value="", label="Test", on_change=self._choose_test
            ).classes("w-40")
            upload = file_upload("Plan file (TOML)", max_file_size=MAX_BYTES, on_upload=self._load)
            upload.props("accept=.toml flat bordered dense").classes("w-72")
            self._loaded = ui.label().classes("soft")

    def _choose_test(self, event: events.ValueChangeEventArguments[str]) -> None:
        """Take a shipped plan without a plate as what runs where nothing is typed."""
        name = str(event.value or "")
        plan = read_plan(name) if name else Plan()
        self._base, self._file = SweepInputs(plan=plan), name
        self._look()

    @show_errors
    async def _load(self, event: events.UploadEventArguments) -> None:
        """Take a plan file as what runs where nothing is typed."""
        name = event.file.name
        try:
            text = (await event.file.read()).decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise FileFormatError(name, f"it cannot be read as text ({error})") from error
        self._base, self._file = SweepInputs(plan=plan_from_toml(text, name)), name
        self._loaded.set_text(f"{name} is the base; what is typed above replaces parts of it")
        self._look()

    def refresh(self) -> None:
        connection = self._context.bench.connection
        if (connection.session, connection.status) != self._session:
            self._session = connection.session, connection.status
            self._look()
        idle = connection.status == "on" and not connection.weighs
        idle = idle and not self._context.bench.sweep.active
        self._start.set_enabled(idle and self._preview is not None)
        self._resume.set_enabled(idle)

    def _look(self) -> None:
        connection, runs = self._context.bench.connection, self._context.runs
        rig = connection.rig
        problem, self._preview = "", None
        try:
            if rig is None:
                raise InputError("no bench is connected, so there is no rig; connect one first")
            plan = self._form.make(self._base).plan.resolved(rig)
            self._form.show_empty(plan_texts(plan, rig))
            self._form.show_fields(PLATE_FIELDS, plan.plate.used)
            limits = connection.identity.limits if connection.identity else None
            self._preview = build_preview(plan, rig, limits)
        except BenchtoolError as error:
            problem = str(error)
        self._problem.set_text(problem)
        self._problem.set_visibility(bool(problem))
        show_facts(self._facts, self._preview.facts if self._preview else {})
        self._order.rows = list(self._preview.order) if self._preview else []
        self._order.update()
        given = {
            "address": connection.address or "ADDRESS",
            "plan": self._file,
            "rig": rig.name if rig and not connection.address.startswith("sim:") else None,
            "runs": None if runs == SweepInputs().runs else runs,
        }
        self._command.show(["sweep", *self._form.words(given)])

    @show_errors
    def _arm(self) -> None:
        self._context.require_control()
        self._look()
        if self._preview is None:
            raise InputError(self._problem.text)
        self._confirm(self._preview.arming, None)

    def _confirm(self, text: str, resume: Path | None) -> None:
        def begin(typed: str, needs_page: bool) -> None:
            inputs = SweepInputs() if resume else self._form.make(self._base)
            inputs = replace(inputs, runs=self._context.runs, resume=resume)
            self._context.bench.send(StartSweep(inputs, typed, needs_page))
            # Its progress stands above.
            ui.run_javascript("window.scrollTo({top: 0, behavior: 'smooth'})")

        confirm_arming(self._context, self._card, text, begin)

    @show_errors
    async def _choose(self) -> None:
        self._context.require_control()
        names = await run.io_bound(stopped_runs, self._context.runs)
        if not names:
            raise InputError(f"no sweep in {self._context.runs} was stopped before its end")
        with open_dialog("Resume a run") as dialog:
            chosen = ui.select(list(names), value=names[0]).classes("w-full")

            @show_errors
            def resume() -> None:
                path = RunsFolder(self._context.runs).path_of(chosen.value)
                with self._card:
                    self._confirm(f"the rest of {chosen.value} is measured", path)
                dialog.close()

            with ui.row():
                ui.button("Resume", on_click=resume)
                ui.button("Cancel", on_click=dialog.close).props("outline")


def stopped_runs(folder: Path) -> list[str]:
    """Return the names of sweeps that were stopped, newest first."""
    found = []
    for path in folder.glob("*/metadata.json"):
        try:
            facts = read_json(path)
        except BenchtoolError:
            continue
        sweeps = facts.get("experiment") is None and (path.parent / "plan.toml").is_file()
        if sweeps and facts.get("state") == "stopped":
            found.append((path.stat().st_mtime, path.parent.name))
    return [name for _, name in sorted(found, reverse=True)]
