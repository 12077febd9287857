"""A table that somebody hands over to the page: checked as untrusted, kept in the runs folder."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from datetime import datetime
from typing import Any

from nicegui import events, ui

from benchtool.store.runs_folder import RunsFolder
from benchtool.store.upload import MOST_BYTES, keep_table
from benchtool.web.context import Context
from benchtool.web.tell import tells_errors


class HandOver:
    """Take CSV files.

    Args:
        context: of the page.
        kept: called with the name of each in the runs folder.
    """

    def __init__(self, context: Context, kept: Callable[[str], Awaitable[None] | None]) -> None:
        self._context, self._kept = context, kept
        self._folder = RunsFolder(context.runs)
        self._upload = ui.upload(
            label="Or hand over a CSV file",
            auto_upload=True,
            max_file_size=MOST_BYTES,
            on_upload=self._received,
            on_rejected=self._rejected,
        )
        self._upload.props('accept=".csv,text/csv,.txt" flat bordered').classes("w-full")

    @tells_errors
    async def _received(self, event: events.UploadEventArguments) -> None:
        try:
            self._context.need_pen()
            size = event.file.size()
            data = await event.file.read() if size <= MOST_BYTES else bytes(MOST_BYTES + 1)
            date = f"{datetime.now().astimezone():%Y-%m-%d}"
            path = await asyncio.to_thread(keep_table, self._folder, event.file.name, data, date)
        finally:
            self._upload.reset()
        following = self._kept(self._folder.name_of(path))
        if following is not None:
            await following

    def _rejected(self, _: Any) -> None:
        ui.notify(
            f"that is no CSV file of at most {MOST_BYTES / 1e6:.0f} MB; choose another, or put it "
            f"into the runs folder yourself",
            type="negative",
            position="bottom-left",
        )
