"""Data of a fit: selection of runs and tables, upload, and column maps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from nicegui import ui

from benchtool.core.channel import ColumnSource, unit_from_name
from benchtool.core.errors import InputError
from benchtool.core.units import UNITS, find_unit
from benchtool.data.column_map import guess_columns, read_column_map
from benchtool.data.csv_text import read_csv_header
from benchtool.data.formats.formats import is_stand_table
from benchtool.data.run.entry import Entry
from benchtool.data.run.runs_folder import column_map_path
from benchtool.web.context import PageContext, RunsListing
from benchtool.web.entries import store_columns, store_radius
from benchtool.web.widgets import (
    add_table_upload,
    multiple_choice,
    notify,
    notify_error,
    open_tab,
    replace_options,
    show_errors,
    show_html,
)

FIT_CHANNELS = {
    "thrust_N": "thrust_N (required)",
    "thrust_ratio": "thrust_ratio (T/T_OGE, instead of thrust)",
    "thrust_se_N": "thrust_se_N (standard error of thrust)",
    "thrust_sd_N": "",
    "plate_z_m": "plate_z_m (rotor plane to plate)",
    "rpm1": "rpm1 (or speed of all rotors)",
    "rpm2": "",
    "rpm3": "",
    "rpm4": "",
    "pwm1_us": "pwm1_us (without rpm)",
    "plate_tilt_deg": "",
    "plate_x_m": "",
    "coverage1": "",
    "voltage_V": "",
    "time_s": "",
}
"""Channels of a fit (docs/how-to/fit.md#csv-files); those with a label are always visible."""

NONE, CONSTANT = "", "\0constant"  # choices that are not a column


def allowed_units(channel: str) -> tuple[str, ...]:
    """Return the allowed units of a channel's column, default first."""
    default = unit_from_name(channel)
    dimension = find_unit(default).dimension
    others = (symbol for symbol, unit in UNITS.items() if unit.dimension == dimension)
    return (default, *(symbol for symbol in others if symbol != default))


def load_columns(table: Path) -> dict[str, ColumnSource]:
    """Return the stored column map of a table, or one guessed from its header."""
    stored = column_map_path(table)
    if stored.is_file():
        return dict(read_column_map(stored))
    return guess_columns(read_csv_header(table), FIT_CHANNELS)


def check_columns(form: Mapping[str, ColumnSource | None]) -> dict[str, ColumnSource]:
    """Return the column map of a form; raise without thrust, or without speed and pulse width."""
    columns = {channel: source for channel, source in form.items() if source is not None}
    if not {"thrust_N", "thrust_ratio"} & set(columns):
        raise InputError("thrust_N has no column; select the column with thrust")
    if not {"rpm1", "pwm1_us"} & set(columns):
        raise InputError(
            "neither rpm1 nor pwm1_us has a column; select a column with rotor speed or pulse "
            "width, or one number for all rows of rpm1"
        )
    return columns


class DataCard:
    """Selection of the data to fit."""

    def __init__(
        self,
        context: PageContext,
        listing: RunsListing,
        on_change: Callable[[], None],
        on_rig_written: Callable[[str], None],
    ) -> None:
        self._context, self._listing, self._on_change = context, listing, on_change
        self._on_rig_written = on_rig_written
        self._folder = listing.folder
        self.entries: dict[str, Entry] = {}
        self.choice = multiple_choice("Runs and tables", self._show_columns)
        self.choice.on("popup-show", self.refresh)
        add_table_upload(context, self._uploaded)
        self._columns = ui.column().classes("w-full")
        self._update_options()

    @property
    def names(self) -> list[str]:
        """Selected entries that still exist, in order of selection."""
        return [name for name in self.choice.value or [] if name in self.entries]

    async def select(self, names: list[str]) -> None:
        await self.refresh()
        for name in names:
            if name not in self.entries:
                self._folder.find_path(name)  # raises for an invalid name
                notify(f"{name} is not selected: it is neither a sweep nor a readable table")
        self.choice.set_value([name for name in names if name in self.entries])

    @show_errors
    async def refresh(self) -> None:
        if await self._listing.refresh():
            self._update_options()

    def _update_options(self) -> None:
        self.entries = {entry.name: entry for entry in self._listing.entries if entry.can_fit}
        options = {
            name: f"{name} ({', '.join(filter(None, (entry.rig, entry.summary)))})"
            for name, entry in self.entries.items()
        }
        replace_options(self.choice, options)

    def _show_columns(self) -> None:
        self._columns.clear()
        with self._columns:
            for name in self.names:
                if self.entries[name].kind == "table":
                    try:
                        if not is_stand_table(self._folder.find_file(name)):
                            self._add_column_form(name)
                        self._add_radius_field(name)
                    except Exception as error:  # noqa: BLE001 -- the page stays usable
                        notify_error(error)
        self._on_change()

    @show_errors
    async def _uploaded(self, name: str) -> None:
        await self.refresh()
        notify(f"saved as {name}")
        if is_stand_table(self._folder.find_file(name)):
            open_tab("runs", run=name)  # motor constants and comparisons; a fit needs a plate
        else:
            self.choice.set_value([*self.names, name])

    def _add_radius_field(self, name: str) -> None:
        """Add a field and a button to write a rig file with only the rotor radius."""
        with ui.row().classes("items-end w-full gap-3"):
            radius = ui.number(f"Rotor radius of {name}, m", placeholder="empty: from the table")
            radius.props("dense stack-label step=any").classes("grow")
            make = ui.button("Make a rig of it").props("outline dense")

        @show_errors
        async def store() -> None:
            self._context.claim_control()
            path = await self._context.compute("tables", store_radius, name, radius.value)
            notify(f"written: {path.name}")
            self._on_rig_written(str(path))

        make.on_click(store)

    def _add_column_form(self, name: str) -> None:
        path = self._folder.find_file(name)
        header, columns = read_csv_header(path), load_columns(path)
        main = [channel for channel, label in FIT_CHANNELS.items() if label or channel in columns]
        extra = [channel for channel in FIT_CHANNELS if channel not in main]
        readers: dict[str, Callable[[], ColumnSource | None]] = {}
        with ui.expansion(f"Columns of {name}", value=not column_map_path(path).is_file()) as form:
            form.classes("w-full bordered")
            hint = "Select the column of each channel; channels without a column are not used."
            ui.label(hint).classes("soft")
            for channel in main:
                readers[channel] = _add_column_fields(channel, columns.get(channel), header)
            with ui.expansion("More channels").classes("w-full"):
                for channel in extra:
                    readers[channel] = _add_column_fields(channel, None, header)
            use = ui.button("Use these columns").props("outline no-caps")
            result = ui.column().classes("w-full")

        @show_errors
        async def store() -> None:
            self._context.claim_control()
            result.clear()
            columns = check_columns({name: readers[name]() for name in FIT_CHANNELS})
            section = await self._context.compute("tables", store_columns, name, columns)
            with result:
                show_html(section)
            self._on_change()

        use.on_click(store)


def _add_column_fields(
    channel: str, source: ColumnSource | None, header: tuple[str, ...]
) -> Callable[[], ColumnSource | None]:
    """Add the fields of one channel and return a function that reads them."""
    default_unit = unit_from_name(channel)
    choices = {NONE: "–", CONSTANT: "one number for all rows"}
    choices |= {cell: cell for cell in header if cell}
    value = NONE if source is None else source.column or CONSTANT
    with ui.row().classes("items-center w-full gap-3"):
        column = ui.select(choices, value=value if value in choices else NONE)
        column.props(f'dense outlined label="{FIT_CHANNELS[channel] or channel}"').classes("grow")
        number = ui.number(value=source.constant if source else None)
        number.props(f'dense outlined step=any label="{channel} in every row"').classes("w-44")
        number.bind_visibility_from(column, "value", value=CONSTANT)
        unit = ui.select(
            list(allowed_units(channel)), value=(source and source.unit) or default_unit
        )
        unit.props(f'dense outlined label="unit" aria-label="unit of {channel}"').classes("w-28")
        reverse = ui.checkbox("reversed", value=source is not None and source.sign < 0)
        reverse.props(f'dense aria-label="sign of {channel} is reversed"')

    def read() -> ColumnSource | None:
        name, symbol = str(column.value), str(unit.value)
        if name == NONE or (name == CONSTANT and number.value is None):
            return None
        if source is not None and (name, symbol) == (source.column, source.unit or default_unit):
            return replace(source, sign=-1 if reverse.value else 1)
        return ColumnSource(
            column=None if name == CONSTANT else name,
            constant=number.value if name == CONSTANT else None,
            unit=None if symbol == default_unit else symbol,
            sign=-1 if reverse.value else 1,
        )

    return read
