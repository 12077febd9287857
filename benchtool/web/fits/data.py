"""The data of a fit on the page: runs and tables to choose, a table to hand over, its columns."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from benchtool.store.entry import Entry
from benchtool.web.context import Context
from benchtool.web.fits.columns_form import ColumnsForm
from benchtool.web.hand_over import HandOver
from benchtool.web.runs.listing import Listing
from benchtool.web.tell import say, say_error, tells_errors


class Data:
    """Choose what is fitted.

    Args:
        context: of the page.
        listing: of the runs folder.
        changed: called after every change.
    """

    def __init__(self, context: Context, listing: Listing, changed: Callable[[], None]) -> None:
        self._context, self._listing, self._changed = context, listing, changed
        self._folder = listing.folder
        self.entries: dict[str, Entry] = {}
        self._choice = ui.select({}, multiple=True, label="Runs and tables", on_change=self._take)
        self._choice.props("use-chips use-input input-debounce=0").classes("w-full").mark("data")
        self._choice.on("popup-show", self.look)
        HandOver(context, self._handed)
        self._columns = ui.column().classes("w-full")
        self._offer()

    @property
    def names(self) -> list[str]:
        """What is chosen and still there, in the order of choosing."""
        return [name for name in self._choice.value or [] if name in self.entries]

    async def choose(self, names: list[str]) -> None:
        """Choose these, as far as they can be fitted."""
        await self.look()
        for name in names:
            if name not in self.entries:
                self._folder.path_of(name)  # says what is wrong with a name
                say(f"{name} is neither a sweep nor a table that can be read, so it is not fitted")
        self._choice.set_value([name for name in names if name in self.entries])

    @tells_errors
    async def look(self) -> None:
        """Offer what is in the runs folder now."""
        if await self._listing.look():
            self._offer()

    def _offer(self) -> None:
        found = [entry for entry in self._listing.entries if entry.can_fit]
        self.entries = {entry.name: entry for entry in found}
        offered = {
            entry.name: f"{entry.name} ({', '.join(filter(None, (entry.rig, entry.said)))})"
            for entry in found
        }
        if offered != self._choice.options:
            self._choice.set_options(offered, value=self.names)

    def _take(self) -> None:
        tables = [name for name in self.names if self.entries[name].kind == "table"]
        self._columns.clear()
        with self._columns:
            for name in tables:
                self._form(name)
        self._changed()

    def _form(self, name: str) -> None:
        try:
            ColumnsForm(self._context, name, self._changed)
        except Exception as error:  # noqa: BLE001 -- told on the page, which stays usable
            say_error(error)

    @tells_errors
    async def _handed(self, name: str) -> None:
        await self.look()
        say(f"kept as {name}; say which column is which")
        self._choice.set_value([*self.names, name])
