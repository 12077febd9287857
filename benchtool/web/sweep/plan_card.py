"""Edit a plan, see what it comes to, start it, or go on with a run that was stopped."""

from __future__ import annotations

from pathlib import Path

from nicegui import run, ui

from benchtool.core.rig import Rig
from benchtool.errors import BenchtoolError, InputError
from benchtool.store.atomic import read_json
from benchtool.web.arm_dialog import confirm_arming
from benchtool.web.command_row import CommandRow
from benchtool.web.context import Context
from benchtool.web.desk.asks import Sweep
from benchtool.web.sweep.form import PlanForm
from benchtool.web.sweep.preview import Preview, preview_of
from benchtool.web.tell import tells_errors


class PlanCard:
    """Offer the plan and its start."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._session: tuple[int, str] = (-1, "")
        self._preview: Preview | None = None
        with ui.card().classes("w-full") as self._card:
            ui.label("Plan").classes("card-title").props("role=heading aria-level=2")
            self._form = PlanForm(self._look)
            self._facts = ui.element("div").classes("facts-grid").mark("preview")
            self._problem = ui.label().classes("warn-box w-full").mark("problem")
            with ui.expansion("Order of the visits").classes("w-full").props("dense"):
                self._order = ui.table(
                    rows=[],
                    columns=[
                        {"name": name, "label": name, "field": name, "align": "right"}
                        for name in ("visit", "kind", "z/R", "us", "repeat")
                    ],
                    row_key="visit",
                    pagination=12,
                ).props("dense flat")
            with ui.row().classes("items-center w-full"):
                self._start = ui.button("Start the sweep", icon="play_arrow", on_click=self._ask)
                self._resume = ui.button("Go on with a stopped run", on_click=self._choose)
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
        idle = idle and not self._context.bench.swept.active
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
            plan = self._form.plan()
            self._form.show_values(plan.resolved(rig), rig)
            self._preview = preview_of(plan, rig, limits)
            self._form.air()
        except BenchtoolError as error:
            problem = str(error)
        self._problem.set_text(problem)
        self._problem.set_visibility(bool(problem))
        self._facts.clear()
        self._order.rows = []
        if self._preview is not None:
            names = ("visit", "kind", "z/R", "us", "repeat")
            self._order.rows = [dict(zip(names, row, strict=True)) for row in self._preview.order]
            with self._facts:
                for name, text in self._preview.facts.items():
                    ui.label(name)
                    ui.label(text)
        self._order.update()
        rig_words = ["--rig", connection.rig.name] if connection.rig else []
        if connection.address.startswith("sim:"):
            rig_words = []
        address = connection.address or "ADDRESS"
        words = [*rig_words, *self._form.words(), *self._context.runs_words]
        self._command.show(["sweep", address, *words])

    @tells_errors
    def _ask(self) -> None:
        """Show what will spin, and want a confirmation where a motor turns."""
        self._context.need_control()
        self._look()
        if self._preview is None:
            raise InputError(self._problem.text)
        self._confirm(self._preview.arming, None)

    def _confirm(self, text: str, resume: Path | None) -> None:
        confirm_arming(self._context, self._card, text, lambda typed: self._begin(typed, resume))

    def _begin(self, typed: str, resume: Path | None) -> None:
        self._context.bench.ask(
            Sweep(
                plan=None if resume else self._form.plan(),
                resume=resume,
                runs=self._context.runs,
                typed=typed,
                operator=self._form.text("operator") or "",
                air=self._form.air(),
                calibration=self._form.text("calibration"),
                stage=self._form.text("stage"),
            )
        )
        # Its progress stands above.
        ui.run_javascript("window.scrollTo({top: 0, behavior: 'smooth'})")

    @tells_errors
    async def _choose(self) -> None:
        """Offer the runs that were stopped."""
        self._context.need_control()
        names = await run.io_bound(stopped_runs, self._context.runs)
        if not names:
            raise InputError(f"no sweep in {self._context.runs} was stopped before its end")
        with ui.dialog() as dialog, ui.card().classes("w-96"):
            ui.label("Go on with").classes("card-title")
            chosen = ui.select(list(names), value=names[0]).classes("w-full")

            @tells_errors
            def go_on() -> None:
                path = self._context.run_path(chosen.value)
                with self._card:
                    self._confirm(f"the rest of {chosen.value} is measured", path)
                dialog.close()

            with ui.row():
                ui.button("Go on", on_click=go_on)
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
