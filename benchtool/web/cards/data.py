"""Data of a fit: selection of runs and tables, upload, and column maps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from nicegui import ui

from benchtool.core.channel import ColumnSource, unit_from_name
from benchtool.core.errors import InputError
from benchtool.core.units import UNITS, find_unit
from benchtool.data.column_map import find_conversion, guess_columns, name_and_unit, read_column_map
from benchtool.data.csv_text import read_csv_header
from benchtool.data.formats.formats import is_stand_table
from benchtool.data.run.entry import Entry
from benchtool.data.run.runs_folder import column_map_path
from benchtool.web import widgets
from benchtool.web.context import PageContext, RunsListing
from benchtool.web.entries import store_columns, store_radius

FIT_CHANNELS = {
    "thrust_N": "thrust_N (required)",
    "thrust_ratio": "thrust_ratio (T/T_OGE, instead of thrust)",
    "thrust_se_N": "thrust_se_N (standard error of thrust)",
    "plate_z_m": "plate_z_m (rotor plane to plate)",
    "rpm1": "rpm1 (or speed of all rotors)",
    "pwm1_us": "pwm1_us (without rpm)",
    **dict.fromkeys(("thrust_sd_N", "rpm2", "rpm3", "rpm4", "plate_tilt_deg", "plate_x_m"), ""),
    **dict.fromkeys(("coverage1", "voltage_V", "time_s"), ""),
}
"""Channels of a fit (docs/how-to/fit.md#csv-files); those with a label are always visible."""

NONE, CONSTANT = "", "\0constant"  # choices that are not a column


def allowed_units(channel: str) -> tuple[str, ...]:
    """Return the allowed units of a channel's column, default first."""
    default = unit_from_name(channel)
    dimension = find_unit(default).dimension
    others = (symbol for symbol, unit in UNITS.items() if unit.dimension == dimension)
    return (default, *(symbol for symbol in others if symbol != default))


def displayed_unit(channel: str, column: str, unit: str | None = None) -> str | None:
    """Return the unit of a column, by default that in its name; None if it is unknown."""
    default = unit_from_name(channel)
    unit = unit or name_and_unit(column)[1] or default
    try:
        conversion = find_conversion(unit, default)
    except InputError:
        return None
    same = (text for text in allowed_units(channel) if find_conversion(text, default) == conversion)
    return next(same, unit)


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
        self.choice = widgets.multiple_choice("Runs and tables", self._show_columns)
        self.choice.on("popup-show", self.refresh)
        widgets.add_table_upload(context, self._uploaded)
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
                widgets.notify(
                    f"{name} is not selected: it is neither a sweep nor a readable table"
                )
        self.choice.set_value([name for name in names if name in self.entries])

    @widgets.show_errors
    async def refresh(self) -> None:
        if await self._listing.refresh():
            self._update_options()

    def _update_options(self) -> None:
        self.entries = {entry.name: entry for entry in self._listing.entries if entry.can_fit}
        options = {
            name: f"{name} ({', '.join(filter(None, (entry.rig, entry.summary)))})"
            for name, entry in self.entries.items()
        }
        widgets.replace_options(self.choice, options)

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
                        widgets.notify_error(error)
        self._on_change()

    @widgets.show_errors
    async def _uploaded(self, name: str) -> None:
        await self.refresh()
        widgets.notify(f"saved as {name}")
        if is_stand_table(self._folder.find_file(name)):
            # Motor constants and comparisons; a fit needs a plate.
            widgets.open_tab("runs", run=name)
        else:
            self.choice.set_value([name])

    def _add_radius_field(self, name: str) -> None:
        """Add a field and a button to write a rig file with only the rotor radius."""
        with ui.row().classes("items-end w-full gap-3"):
            radius = ui.number(f"Rotor radius of {name}, m", placeholder="empty: from the table")
            radius.props("dense stack-label step=any").classes("grow")
            make = ui.button("Make a rig of it").props("outline dense")

        @widgets.show_errors
        async def store() -> None:
            self._context.claim_control()
            path = await self._context.compute("tables", store_radius, name, radius.value)
            widgets.notify(f"written: {path.name}")
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

        @widgets.show_errors
        async def store() -> None:
            self._context.claim_control()
            result.clear()
            columns = check_columns({name: readers[name]() for name in FIT_CHANNELS})
            section = await self._context.compute("tables", store_columns, name, columns)
            with result:
                widgets.show_html(section)
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
        unit = ui.select([]).props("hide-bottom-space")
        unit.props(
            f'dense outlined hide-bottom-space label="unit" aria-label="unit of {channel}"'
        ).classes("w-28")
        reverse = ui.checkbox("reversed", value=source is not None and source.sign < 0)
        reverse.props(f'dense aria-label="sign of {channel} is reversed"')

    def show_unit(known: str | None = None) -> None:
        symbol = displayed_unit(channel, str(column.value), known)
        units = dict.fromkeys((*allowed_units(channel), symbol or default_unit))
        unit.set_options([*units], value=symbol)
        unit.validation = {f"unit of {column.value} is not known; select one": bool}

    stored = source or ColumnSource(column=NONE)
    show_unit(stored.unit or (None if stored.factor == 1.0 else default_unit))
    first = column.value, unit.value
    column.on_value_change(lambda: show_unit())

    def read() -> ColumnSource | None:
        name, symbol = str(column.value), str(unit.value)
        if name == NONE or (name == CONSTANT and number.value is None):
            return None
        if not unit.validate():
            raise InputError(str(unit.error))
        if source is not None and (name, symbol) == first:
            return replace(source, sign=-1 if reverse.value else 1)
        return ColumnSource(
            column=None if name == CONSTANT else name,
            constant=number.value if name == CONSTANT else None,
            unit=None if symbol == default_unit == displayed_unit(channel, name) else symbol,
            sign=-1 if reverse.value else 1,
        )

    return read
