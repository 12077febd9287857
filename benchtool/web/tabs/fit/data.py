"""The data of a fit on the page: runs and tables to choose, a table to upload, its columns."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from nicegui import ui

from benchtool.core.channel import unit_from_name
from benchtool.core.column_source import ColumnSource
from benchtool.core.errors import InputError
from benchtool.core.units import UNITS, find_unit
from benchtool.data.column_map import guess_columns, read_column_map
from benchtool.data.csv_text import read_csv_header
from benchtool.data.formats.formats import is_stand_table
from benchtool.data.run.entry import Entry
from benchtool.data.run.runs_folder import columns_file
from benchtool.web.context import PageContext, RunsListing
from benchtool.web.tabs.fit.work import stand_summary_html, store_columns, store_radius
from benchtool.web.widgets import TableUpload, multiple_choice, notify, notify_error, show_errors

FIT_CHANNELS = {
    "thrust_N": "thrust_N (needed)",
    "thrust_ratio": "thrust_ratio (T/T_OGE, in place of a thrust)",
    "thrust_se_N": "thrust_se_N (its standard error)",
    "thrust_sd_N": "",
    "plate_z_m": "plate_z_m (rotor plane to plate)",
    "rpm1": "rpm1 (or that of all rotors)",
    "rpm2": "",
    "rpm3": "",
    "rpm4": "",
    "pwm1_us": "pwm1_us (where there is no rpm)",
    "plate_tilt_deg": "",
    "plate_x_m": "",
    "coverage1": "",
    "voltage_V": "",
    "time_s": "",
}
"""Channels that a fit uses, as docs/how-to/fit.md#csv-files lists them; those with words for people
stand first, the others in a list that can be opened."""

NONE, CONSTANT = "", "\0constant"  # Choices of a column that are no column


def units_for(channel: str) -> tuple[str, ...]:
    """Return the units that a column of a channel may have, ours first."""
    own = unit_from_name(channel)
    dimension = find_unit(own).dimension
    others = (symbol for symbol, unit in UNITS.items() if unit.dimension == dimension)
    return (own, *(symbol for symbol in others if symbol != own))


def columns_for(table: Path, radius_m: float | None = None) -> dict[str, ColumnSource]:
    """Return the columns of a table as they were stored, or else as its header suggests."""
    stored = columns_file(table)
    if stored.is_file():
        return dict(read_column_map(stored))
    return guess_columns(read_csv_header(table), FIT_CHANNELS, radius_m)


def chosen_columns(form: Mapping[str, ColumnSource | None]) -> dict[str, ColumnSource]:
    """Return the columns that a form was filled with.

    Raises:
        InputError: no thrust, or neither speed nor pulse width of rotors.
    """
    columns = {channel: source for channel, source in form.items() if source is not None}
    if not {"thrust_N", "thrust_ratio"} & set(columns):
        raise InputError("no column is thrust_N; choose the one with the thrust")
    if not {"rpm1", "pwm1_us"} & set(columns):
        raise InputError(
            "neither rpm1 nor pwm1_us has a column; choose one with rotor speed or pulse width, or "
            "give rpm1 one number for all rows"
        )
    return columns


class DataCard:
    """Choose what is fitted."""

    def __init__(
        self,
        context: PageContext,
        listing: RunsListing,
        changed: Callable[[], None],
        rig_made: Callable[[str], None],
    ) -> None:
        self._context, self._listing, self._changed = context, listing, changed
        self._rig_made = rig_made
        self._folder = listing.folder
        self.entries: dict[str, Entry] = {}
        self.choice = multiple_choice("Runs and tables", self._show_columns)
        self.choice.on("popup-show", self.look)
        TableUpload(context, self._uploaded)
        self._columns = ui.column().classes("w-full")
        self._offer()

    @property
    def names(self) -> list[str]:
        """What is chosen and still there, in the order of choosing."""
        return [name for name in self.choice.value or [] if name in self.entries]

    async def choose(self, names: list[str]) -> None:
        await self.look()
        for name in names:
            if name not in self.entries:
                self._folder.path_of(name)  # raises what is wrong with a name
                notify(f"{name} is not fitted: it is neither a sweep nor a readable table")
        self.choice.set_value([name for name in names if name in self.entries])

    @show_errors
    async def look(self) -> None:
        if await self._listing.look():
            self._offer()

    def _offer(self) -> None:
        self.entries = {entry.name: entry for entry in self._listing.entries if entry.can_fit}
        offered = {
            name: f"{name} ({', '.join(filter(None, (entry.rig, entry.summary)))})"
            for name, entry in self.entries.items()
        }
        if offered != self.choice.options:
            self.choice.set_options(offered, value=self.names)

    def _show_columns(self) -> None:
        self._columns.clear()
        with self._columns:
            for name in self.names:
                if self.entries[name].kind == "table":
                    try:
                        if is_stand_table(self._folder.file_of(name)):
                            self._stand_findings(name)
                        else:
                            self._columns_form(name)
                        self._radius_fields(name)
                    except Exception as error:  # noqa: BLE001 -- the page stays usable
                        notify_error(error)
        self._changed()

    @show_errors
    async def _uploaded(self, name: str) -> None:
        await self.look()
        notify(f"saved as {name}")
        self.choice.set_value([*self.names, name])

    def _stand_findings(self, name: str) -> None:
        """Show what the import finds in a stand's table, whose columns are known."""
        with ui.expansion(f"Import of {name}").classes("w-full bordered") as shown:
            place = ui.column().classes("w-full")

        @show_errors
        async def fill() -> None:
            if not shown.value or place.default_slot.children:
                return
            worker = self._context.worker("tables")
            html = await worker.run(stand_summary_html, self._context.runs, name)
            with place:
                ui.html(html, sanitize=False).classes("shown-body")

        shown.on_value_change(fill)

    def _radius_fields(self, name: str) -> None:
        """Offer to write a rig of the rotor's radius alone, for who has no rig file."""
        with ui.row().classes("items-end w-full gap-3"):
            radius = ui.number(f"Rotor radius of {name}, m", placeholder="empty: as it states")
            radius.props("dense stack-label step=any").classes("grow")
            make = ui.button("Make a rig of it").props("outline dense")

        @show_errors
        async def store() -> None:
            self._context.claim_control()
            worker = self._context.worker("tables")
            path = await worker.run(store_radius, self._context.runs, name, radius.value)
            notify(f"written: {path.name}")
            self._rig_made(str(path))

        make.on_click(store)

    def _columns_form(self, name: str) -> None:
        """Make the fields in which the columns of a table are chosen.

        Raises:
            BenchtoolError: the table cannot be read.
        """
        path = self._folder.file_of(name)
        header, known = read_csv_header(path), columns_for(path)
        first = [channel for channel, label in FIT_CHANNELS.items() if label or channel in known]
        more = [channel for channel in FIT_CHANNELS if channel not in first]
        readers: dict[str, Callable[[], ColumnSource | None]] = {}
        with ui.expansion(f"Columns of {name}", value=not columns_file(path).is_file()) as form:
            form.classes("w-full bordered")
            ui.label("Choose the column of each channel; what is left empty is not used.").classes(
                "soft"
            )
            for channel in first:
                readers[channel] = _column_fields(channel, known.get(channel), header)
            with ui.expansion("More channels").classes("w-full"):
                for channel in more:
                    readers[channel] = _column_fields(channel, None, header)
            use = ui.button("Use these columns").props("outline no-caps")
            result = ui.column().classes("w-full")

        @show_errors
        async def store() -> None:
            self._context.claim_control()
            result.clear()
            columns = chosen_columns({name: readers[name]() for name in FIT_CHANNELS})
            worker = self._context.worker("tables")
            html = await worker.run(store_columns, self._context.runs, name, columns)
            with result:
                ui.html(html, sanitize=False).classes("w-full")
            self._changed()

        use.on_click(store)


def _column_fields(
    channel: str, source: ColumnSource | None, header: tuple[str, ...]
) -> Callable[[], ColumnSource | None]:
    """Make the fields of one channel, and return what reads them."""
    own = unit_from_name(channel)
    choices = {NONE: "–", CONSTANT: "one number for all rows"}
    choices |= {cell: cell for cell in header if cell}
    value = NONE if source is None else source.column or CONSTANT
    with ui.row().classes("items-center w-full gap-3 column-line"):
        column = ui.select(choices, value=value if value in choices else NONE)
        column.props(f'dense outlined label="{FIT_CHANNELS[channel] or channel}"').classes("grow")
        number = ui.number(value=source.constant if source else None)
        number.props(f'dense outlined step=any label="{channel} in every row"').classes("w-40")
        number.bind_visibility_from(column, "value", value=CONSTANT)
        unit = ui.select(list(units_for(channel)), value=(source and source.unit) or own)
        unit.props(f'dense outlined label="unit" aria-label="unit of {channel}"').classes("w-28")
        reverse = ui.checkbox("reversed", value=source is not None and source.sign < 0)
        reverse.props(f'dense aria-label="{channel} points the other way"')

    def read() -> ColumnSource | None:
        chosen = str(column.value)
        if chosen == NONE or (chosen == CONSTANT and number.value is None):
            return None
        if (
            source is not None
            and chosen == source.column
            and str(unit.value) == (source.unit or own)
        ):
            return replace(source, sign=-1 if reverse.value else 1)
        return ColumnSource(
            column=None if chosen == CONSTANT else chosen,
            constant=number.value if chosen == CONSTANT else None,
            unit=None if unit.value == own else str(unit.value),
            sign=-1 if reverse.value else 1,
        )

    return read
