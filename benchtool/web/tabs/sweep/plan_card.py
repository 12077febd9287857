"""Edit a plan, see its preview, start it, or resume a run that was stopped."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from nicegui import run, ui

from benchtool.acquire.arming import arming_text
from benchtool.acquire.check_plan import check_plan
from benchtool.acquire.inputs import SweepInputs
from benchtool.acquire.order import expected_duration_s, minutes, settings_of, visits_of
from benchtool.acquire.plan import Plan
from benchtool.core.errors import BenchtoolError, InputError
from benchtool.core.rig import Rig
from benchtool.data.atomic import read_json
from benchtool.web.arm_dialog import confirm_arming
from benchtool.web.bench_process.commands import StartSweep
from benchtool.web.context import PageContext
from benchtool.web.notifications import shows_errors
from benchtool.web.tabs.sweep.form import PlanForm
from benchtool.web.widgets import CommandRow, show_facts, titled_card

SHOWN_VISITS = 400
"""Rows of the order that are shown; a choice."""

COLUMNS = ("visit", "kind", "z/R", "us", "repeat")


@dataclass(frozen=True, slots=True)
class PlanPreview:
    """Hold what is shown of a plan.

    Attributes:
        facts: name to text.
        arming: what the operator must know before confirming.
        order: rows by the names of COLUMNS.
    """

    facts: Mapping[str, str]
    arming: str
    order: Sequence[dict[str, str]]


def preview_of(plan: Plan, rig: Rig, device_limits: Mapping[str, float] | None) -> PlanPreview:
    """Return the preview of a plan, not resolved yet.

    Raises:
        PlanError: the limits of rig or device do not allow it.
    """
    resolved = plan.resolved(rig)
    expected = check_plan(resolved, rig, device_limits)
    visits = visits_of(resolved, rig)
    radius_m = rig.propulsion.radius_m
    kinds = [visit.kind for visit in visits]
    distances = ", ".join(f"{z_m / radius_m:g}" for z_m in resolved.plate.distances_m)
    pulses = ", ".join(f"{pulse:g}" for pulse in resolved.throttle.pwm_us)
    facts = {
        "rig": f"{rig.name}: {rig.title}",
        "plate z/R": distances,
        "pulses": f"{pulses} us",
        "visits": (
            f"{len(visits)}, of {len(settings_of(resolved, rig))} settings: "
            f"{resolved.repeats} repeats, {kinds.count('reference')} references, "
            f"{kinds.count('anchor')} anchors"
        ),
        "duration": f"about {minutes(expected_duration_s(resolved, rig, visits))}",
        "limits hold": (
            f"at most {expected.pwm_us:g} us, about {expected.rpm:.0f} rpm and "
            f"{expected.thrust_N:.1f} N of {rig.limits.thrust_N:g} N"
        ),
    }
    rows = []
    for visit in visits[:SHOWN_VISITS]:
        place, level = visit.setting.place, f"{visit.setting.level_us:g}"
        distance = "parked" if place.parked else f"{place.z_m / radius_m:.2f}"
        row = (str(visit.point), visit.kind, distance, level, str(visit.repeat))
        rows.append(dict(zip(COLUMNS, row, strict=True)))
    return PlanPreview(facts, arming_text(resolved, rig, expected), rows)


class PlanCard:
    """Offer the plan and its start."""

    def __init__(self, context: PageContext) -> None:
        self._context = context
        self._session: tuple[int, str] = (-1, "")
        self._preview: PlanPreview | None = None
        with titled_card("Plan") as self._card:
            self._form = PlanForm(self._look)
            self._facts = ui.element("div").classes("facts-grid").mark("preview")
            self._problem = ui.label().classes("warn-box w-full").mark("problem")
            with ui.expansion("Order of the visits").classes("w-full").props("dense"):
                self._order = ui.table(
                    rows=[],
                    columns=[
                        {"name": name, "label": name, "field": name, "align": "right"}
                        for name in COLUMNS
                    ],
                    row_key="visit",
                    pagination=12,
                ).props("dense flat")
            with ui.row().classes("items-center w-full"):
                self._start = ui.button("Start the sweep", icon="play_arrow", on_click=self._ask)
                self._resume = ui.button("Resume a stopped run", on_click=self._choose)
                self._resume.props("outline")
            self._command = CommandRow()
        self._look()

    def refresh(self) -> None:
        """Show what is so now."""
        connection = self._context.bench.connection
        if (connection.session, connection.status) != self._session:
            self._session = connection.session, connection.status
            self._look()
        idle = connection.status == "on" and not connection.weighs
        idle = idle and not self._context.bench.sweep.active
        self._start.set_enabled(idle and self._preview is not None)
        self._resume.set_enabled(idle)

    def _rig(self) -> Rig:
        rig = self._context.bench.connection.rig
        if rig is None:
            raise InputError("no bench is connected, so there is no rig; connect one first")
        return rig

    def _look(self) -> None:
        """Work out the preview anew."""
        connection = self._context.bench.connection
        problem = ""
        self._preview = None
        try:
            rig = self._rig()
            limits = connection.identity.limits if connection.identity else None
            plan = self._form.inputs().plan
            self._form.show_values(plan.resolved(rig), rig)
            self._preview = preview_of(plan, rig, limits)
        except BenchtoolError as error:
            problem = str(error)
        self._problem.set_text(problem)
        self._problem.set_visibility(bool(problem))
        show_facts(self._facts, self._preview.facts if self._preview else {})
        self._order.rows = list(self._preview.order) if self._preview else []
        self._order.update()
        rig_words = ["--rig", connection.rig.name] if connection.rig else []
        if connection.address.startswith("sim:"):
            rig_words = []
        address = connection.address or "ADDRESS"
        words = [*rig_words, *self._form.words(), *self._context.runs_words]
        self._command.show(["sweep", address, *words])

    @shows_errors
    def _ask(self) -> None:
        """Show what will spin, and want a confirmation where a motor turns."""
        self._context.require_control()
        self._look()
        if self._preview is None:
            raise InputError(self._problem.text)
        self._confirm(self._preview.arming, None)

    def _confirm(self, text: str, resume: Path | None) -> None:
        confirm_arming(self._context, self._card, text, lambda typed: self._begin(typed, resume))

    def _begin(self, typed: str, resume: Path | None) -> None:
        inputs = SweepInputs() if resume else self._form.inputs()
        inputs = replace(inputs, runs=self._context.runs, resume=resume)
        self._context.bench.send(StartSweep(inputs, typed))
        # Its progress stands above.
        ui.run_javascript("window.scrollTo({top: 0, behavior: 'smooth'})")

    @shows_errors
    async def _choose(self) -> None:
        """Offer the runs that were stopped."""
        self._context.require_control()
        names = await run.io_bound(stopped_runs, self._context.runs)
        if not names:
            raise InputError(f"no sweep in {self._context.runs} was stopped before its end")
        with ui.dialog() as dialog, ui.card().classes("w-96"):
            ui.label("Resume a run").classes("card-title")
            chosen = ui.select(list(names), value=names[0]).classes("w-full")

            @shows_errors
            def resume() -> None:
                path = self._context.run_path(chosen.value)
                with self._card:
                    self._confirm(f"the rest of {chosen.value} is measured", path)
                dialog.close()

            with ui.row():
                ui.button("Resume", on_click=resume)
                ui.button("Cancel", on_click=dialog.close).props("outline")
        dialog.on_value_change(lambda change: None if change.value else dialog.delete())
        dialog.open()


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
