"""What is in the runs folder, read beside the page's loop and only where something has changed."""

from __future__ import annotations

import asyncio

from benchtool.data.run.entry import Entry, Seen, list_entries
from benchtool.data.run.runs_folder import RunsFolder


class RunsListing:
    """Hold the entries of a runs folder as they were at the last look."""

    def __init__(self, folder: RunsFolder) -> None:
        self.folder = folder
        self.entries: tuple[Entry, ...] = ()
        self._read: Seen = {}
        self._seen: tuple[tuple[str, int], ...] | None = None

    async def look(self) -> bool:
        """Read the folder anew where it has changed; return whether it has."""
        try:
            changed = await asyncio.to_thread(_stamps, self.folder)
            if changed == self._seen:
                return False
            self.entries = await asyncio.to_thread(list_entries, self.folder, self._read)
        except FileNotFoundError:  # something was moved meanwhile; the next look sees it
            return False
        self._seen = changed
        return True


def _stamps(folder: RunsFolder) -> tuple[tuple[str, int], ...]:
    """Return what changes when something comes into the folder, or when a run is closed."""
    if not folder.root.is_dir():
        return ()
    places = [folder.root, *(item for item in folder.root.iterdir() if item.is_dir())]
    return tuple((item.name, item.stat().st_mtime_ns) for item in places)
