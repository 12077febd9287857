"""Runs tab: search, view, comparison and download of entries of the runs folder."""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from nicegui import ui

from benchtool.commands.import_file import ImportInputs
from benchtool.commands.report import ReportInputs
from benchtool.core.inputs import items
from benchtool.data.catalogue.entry import ChoiceInputs, filter_entries
from benchtool.data.formats.formats import is_stand_table
from benchtool.data.propeller_file import propeller_names
from benchtool.data.run.entry import ANSWER_FILE, ENTRY_KINDS, FIT_FILE, SWEEPS, Entry, build_entry
from benchtool.data.run.points import TABLES
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.export.targets import TARGETS
from benchtool.web import entries as views
from benchtool.web import widgets
from benchtool.web.context import PageContext, RunsListing
from benchtool.web.drawing import PageSection
from benchtool.web.form import InputForm

EXPORT_WORKER = "reports"  # process that writes downloads


Download = tuple[str, str, Callable[..., bytes] | None, tuple[Any, ...]]
"""Label and name of a file, and the function in a worker that returns it; None: it exists."""


def downloads(entry: Entry) -> Iterator[Download]:
    """Yield the downloads of an entry; none for an unreadable one."""
    name, flat = entry.name, entry.name.replace("/", "-")
    if entry.problem:
        return
    if entry.kind != "table":
        yield report_download(flat, (name,))
    if entry.kind in ("table", "recording"):
        yield "CSV" if entry.kind == "table" else "Recording", flat, None, (name,)
    elif entry.kind in ("fit", "explanation"):
        files = [FIT_FILE if entry.kind == "fit" else ANSWER_FILE]
        files += ["model.toml"] * (entry.state not in ("stopped early", "not converged"))
        for file in files:
            yield file, f"{flat}-{file}", None, (f"{name}/{file}",)
    else:
        tables = TABLES if entry.kind in SWEEPS else ("samples",)
        for table, label in (*((table, "CSV") for table in tables), ("samples", "Parquet")):
            suffix = f".{label.lower()}"
            yield (
                f"{table}, {label}",
                f"{flat}-{table}{suffix}",
                views.table_bytes,
                (name, table, suffix),
            )


def report_download(name: str, entries: tuple[str, ...]) -> Download:
    """Return the download of a report."""
    return "Report, HTML", f"{name}-report.html", views.report_bytes, (entries,)


def add_download(context: PageContext, download: Download) -> None:
    """Add a button that saves a file of an entry."""
    label, file, function, arguments = download

    async def load() -> tuple[str, bytes | Path]:
        if function is None:
            return file, RunsFolder(context.runs).find_file(*arguments)
        return file, await context.compute(EXPORT_WORKER, function, *arguments)

    _add_save(label, "download", load)


def _add_save(
    label: str, icon: str, load: Callable[[], Awaitable[tuple[str, bytes | Path]]]
) -> None:
    """Add a button that saves a file; `load` returns its name and content."""
    button = ui.button(label, icon=icon).props("outline dense")
    page = ui.context.client

    @widgets.show_errors
    async def save() -> None:
        button.props("loading")
        try:
            file, content = await load()
        finally:
            button.props(remove="loading")
        # In the page's slot: opening another entry deletes the button.
        with page:
            ui.download(content, file)
            widgets.notify(f"saved: {file}")

    button.on_click(save)


class RunDetail:
    """View of one entry, or of several compared, below the list."""

    def __init__(self, context: PageContext, on_compare: Callable[[str], object]) -> None:
        self._context, self._on_compare = context, on_compare
        self._folder = RunsFolder(context.runs)
        self._request_number = 0
        self._propeller = ""  # of a log that names none
        self._container = ui.column().classes("w-full gap-3 scroll-place")

    async def open(self, name: str) -> None:
        self._propeller = ""
        entry = build_entry(self._folder, name)
        result = await self._load(f"reading {name}", views.view_entry, name)
        if result is None:
            return
        section, part_titles = result
        is_motor_log = views.MOTOR_PART in part_titles
        is_stand_log = entry.kind == "table" and is_stand_table(self._folder.find_file(name))
        with self._container, ui.card().classes("w-full"):
            widgets.show_title(section, f"{entry.kind} {entry.state}".strip())
            with ui.row().classes("w-full gap-3 items-center"):
                if is_motor_log:
                    compare = ui.button("Compare", icon="stacked_line_chart").props("dense")
                    compare.on_click(lambda: self._on_compare(name))
                if entry.can_fit and not is_stand_log:  # a stand has no plate
                    fit = ui.button("Fit", icon="functions").props("dense")
                    fit.on_click(lambda: widgets.open_tab("fit", data=name))
                if (entry.kind, entry.state) == ("sweep", "stopped"):
                    resume = ui.button("Resume", icon="play_arrow").props("dense outline")
                    path = self._folder.find_path(name)
                    resume.on_click(
                        lambda: widgets.confirm_resume(self._context, self._container, path)
                    )
                for download in downloads(entry):
                    add_download(self._context, download)
                if not entry.problem and (entry.kind in ("fit", *SWEEPS) or is_motor_log):
                    self._add_export(name)
            if is_motor_log:
                self._add_motor(name)
            widgets.show_section(section)
            for title in part_titles:
                if title != views.MOTOR_PART:
                    load = partial(
                        self._context.compute,
                        views.FIGURE_WORKER,
                        views.view_part,
                        name,
                        title,
                    )
                    widgets.add_section_expansion(title, load, f"drawing {title.lower()}")

    async def compare(
        self, entries: Sequence[Entry], over: str = "", thrust_N: float | None = None
    ) -> None:
        kinds, names = {entry.kind for entry in entries}, tuple(entry.name for entry in entries)
        has_ratios = kinds <= {*SWEEPS} and not over
        over = over if has_ratios or kinds == {"fit"} else over or "thrust"
        text = f"comparing {len(names)}"
        section = await self._load(text, views.view_comparison, names, over, thrust_N)
        if section is None:
            return
        with self._container, ui.card().classes("w-full"):
            widgets.show_title(section)
            if has_ratios:
                add_download(self._context, report_download("compared", names))
            widgets.show_section(section)

    async def _load(self, text: str, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return the result of a worker function, or None if another entry was opened meanwhile."""
        self._request_number += 1
        number = self._request_number
        self._container.clear()
        with self._container:
            widgets.show_spinner(text)
        self._container.run_method("scrollIntoView", {"behavior": "smooth", "block": "start"})
        try:
            result = await self._context.compute(views.FIGURE_WORKER, function, *arguments)
        finally:
            if number == self._request_number:
                self._container.clear()
        return result if number == self._request_number else None

    def _add_motor(self, name: str) -> None:
        """Add thrust curve and motor constants of a log, with a field for its propeller."""
        label = "Propeller, if the log names none: size in inches, or name"
        with ui.row().classes("items-end w-full"):
            field = ui.input(label, autocomplete=[*propeller_names()]).classes("grow")
            field.props("dense").bind_value_to(self, "_propeller")
            button = ui.button("Motor constants", icon="functions").props("outline")
        container = ui.column().classes("w-full")

        def load() -> Awaitable[PageSection]:
            arguments = (name, views.MOTOR_PART, self._propeller)
            return self._context.compute(views.FIGURE_WORKER, views.view_part, *arguments)

        fill = partial(widgets.load_section, container, load, "fitting the motor constants")
        button.on_click(lambda: fill())
        ui.timer(0.0, fill, once=True)

    def _add_export(self, name: str) -> None:
        titles = {key: target.title.partition(":")[0] for key, target in TARGETS.items()}

        def load() -> Awaitable[tuple[str, bytes]]:
            arguments = (name, target.value, self._propeller)
            return self._context.compute(EXPORT_WORKER, views.export_file, *arguments)

        with ui.row().classes("items-center gap-1"):
            target = ui.select(titles, value="ardupilot", label="For")
            target.props("dense").classes("w-44")
            _add_save("Export", "flight", load)


ROWS_PER_PAGE = 10
EMPTY_TEXT = (
    "No entry. Measure a sweep under Sweep, save a simulation under Simulate, or copy run folders "
    "and CSV files to the runs folder; or change the search."
)
REFRESH_INTERVAL_S = 3.0

(_OVER_FIELD,) = (item for item in items(ReportInputs) if item.name == "over")
# Horizontal axes of comparisons.
AXES = {"": "sweeps: thrust ratio"} | {key: f"over {key}" for key in _OVER_FIELD.choices}
COLUMNS = ("name", "kind", "rig", "date", "state", "summary")

_NAME = """
<q-td :props="props"><button type="button" class="run-name"
  @click="$parent.$emit('open', props.row.name)">{{ props.row.name }}</button>
<span v-for="tag in props.row.tags" class="run-tag">{{ tag }}</span></q-td>
"""
_SUMMARY = """
<q-td :props="props"><span :class="props.row.problem ? 'summary problem warn' : 'summary soft'">
<q-icon v-if="props.row.problem" name="warning" aria-label="cannot be read" />
{{ props.row.summary }}</span></q-td>
"""
_CHOOSE = """
<q-checkbox v-model="props.selected" dense :aria-label="'Choose ' + props.row.name" />
"""
_CHOOSE_ALL = '<q-checkbox v-model="props.selected" dense aria-label="Choose all" />'


class RunsTab:
    """List of entries and the detail view of one page."""

    def __init__(self, context: PageContext) -> None:
        self._listing = RunsListing(RunsFolder(context.runs))
        with ui.card().classes("w-full"):
            with ui.row().classes("items-end w-full runs-filter"):
                self._search = ui.input("Search name, rig, date, state, note", on_change=self._fill)
                self._search.classes("grow").props('debounce=120 clearable type="search"')
                kinds = {"": "every kind", **{kind: kind for kind in ENTRY_KINDS}}
                self._kind = ui.select(kinds, value="", label="Kind", on_change=self._fill)
                self._kind.classes("w-44")
                self._tags = ui.select([], multiple=True, label="Tags", on_change=self._fill)
                self._tags.classes("w-44").props("clearable use-chips")
                self._axis = ui.select(AXES, value="", label="Compared", on_change=self._on_select)
                self._axis.classes("w-44")
                self._thrust = ui.number("Ranked at thrust, N").classes("w-44")
                self._compare = ui.button(
                    "Compare", icon="stacked_line_chart", on_click=self._show_comparison
                )
            self._count = ui.label().classes("soft").props("role=status")
            self._table = self._make_table()
            with ui.expansion("Import a table or log").classes("w-full bordered"):
                self._import = InputForm(ImportInputs, lambda: None)
                widgets.add_table_upload(context, self._uploaded, self._import.make)
                ui.label("Options of the import; set them before the upload.").classes("soft")
                with ui.element("div").classes("fit-form"):
                    self._import.add("flip", "tare", "scale", "air_density", "hover", "over")
                    self._import.add("near_m", "propeller")
        context.persist("runs.search", self._search)
        context.persist("runs.kind", self._kind)
        self._detail = RunDetail(context, self._select)
        ui.timer(REFRESH_INTERVAL_S, self._refresh)

    def _make_table(self) -> ui.table:
        table = ui.table(
            columns=[
                {"name": key, "label": "Rig or model" if key == "rig" else key.capitalize(),
                 "field": key, "align": "left", "sortable": True, "headerClasses": key,
                 "classes": key}
                for key in COLUMNS
            ],
            rows=[],
            row_key="name",
            selection="multiple",
            pagination=ROWS_PER_PAGE,
            on_select=self._on_select,
        )  # fmt: skip
        table.classes("runs-table w-full").props("flat dense wrap-cells")
        with table.add_slot("no-data"):
            ui.label(EMPTY_TEXT).classes("soft q-py-sm")
        table.add_slot("body-cell-name", _NAME)
        table.add_slot("body-cell-summary", _SUMMARY)
        table.add_slot("body-selection", _CHOOSE)
        table.add_slot("header-selection", _CHOOSE_ALL)
        table.on("open", lambda event: self.open(str(event.args)))
        return table

    @widgets.show_errors
    async def open(self, name: str) -> None:
        await self._detail.open(name)
        address = json.dumps("?" + urlencode({"tab": "runs", "run": name}))
        ui.run_javascript(f"history.replaceState(null, '', {address})")

    def _select(self, name: str) -> None:
        """Select an entry for a comparison with others over thrust, in the unfiltered list."""
        for field, value in ((self._search, ""), (self._kind, ""), (self._axis, "thrust")):
            field.set_value(value)
        self._table.selected = [row for row in self._table.rows if row["name"] == name]
        self._on_select()
        widgets.notify(f"{name} is selected; select others in the list, then press Compare")
        ui.run_javascript("window.scrollTo(0, 0)")

    @widgets.show_errors
    async def _show_comparison(self) -> None:
        await self._detail.compare(self._comparable(), self._axis.value, self._thrust.value or None)

    def _comparable(self) -> list[Entry]:
        """Return the selected entries that can be compared: fits, or runs and recordings."""
        names = {str(row.get("name")) for row in self._table.selected}
        entries = [entry for entry in self._listing.entries if entry.name in names]
        entries = [entry for entry in reversed(entries) if not entry.problem]
        has_fit = bool(entries) and entries[-1].kind == "fit"
        kinds = ("fit",) if has_fit else (*SWEEPS, "recording", "table")
        return [entry for entry in entries if entry.kind in kinds]

    async def _uploaded(self, name: str) -> None:
        await self._refresh()
        widgets.notify(f"saved as {name}")
        await self.open(name)

    @widgets.show_errors
    async def _refresh(self) -> None:
        if await self._listing.refresh():
            tags = sorted({tag for entry in self._listing.entries for tag in entry.tags})
            widgets.replace_options(self._tags, tags)
            self._tags.set_visibility(bool(tags))
            self._fill()

    def _fill(self) -> None:
        criteria = ChoiceInputs(
            words=self._search.value or "",
            kind=self._kind.value or None,
            tag=tuple(self._tags.value or ()),
        )
        entries = filter_entries(self._listing.entries, criteria)
        rows = [_row(entry) for entry in entries]
        self._table.update_rows(rows, clear_selection=False)
        total = len(self._listing.entries)
        n_unreadable = sum(row["problem"] for row in rows)
        count = f"{len(entries)} of {total}" if len(entries) < total else f"{total}"
        count += f" in {self._listing.folder.root.name}"
        self._count.set_text(count + (f", {n_unreadable} not readable" if n_unreadable else ""))
        self._on_select()

    def _on_select(self) -> None:
        entries = self._comparable()
        count, kinds = len(entries), {entry.kind for entry in entries}
        noun = f"{min(kinds)}s" if len(kinds) == 1 else "runs"
        self._axis.set_visibility(kinds != {"fit"})
        self._thrust.set_visibility(bool(self._axis.value) and kinds != {"fit"})
        self._compare.set_text(f"Compare {count} {noun}" if count > 1 else "Compare")
        self._compare.set_enabled(count > 1)


def build(context: PageContext) -> None:
    """Build the tab; ?run=NAME opens an entry."""
    tab = RunsTab(context)
    if name := ui.context.client.request.query_params.get("run", ""):
        ui.timer(0.0, lambda: tab.open(name), once=True)


def _row(entry: Entry) -> dict[str, Any]:
    state = entry.state + (", simulated" if entry.simulated else "")
    return {
        "name": entry.name,
        "kind": entry.kind,
        "rig": entry.rig,
        "date": entry.date,
        "state": state.removeprefix(", "),
        "summary": entry.problem.removeprefix(f"{entry.name}: ") or entry.summary,
        "problem": bool(entry.problem) and entry.state != "stopped",  # a stop is no problem
        "tags": entry.tags,
    }
