"""The long work of one kind on a server: one at a time, found again by a page loaded anew."""

from __future__ import annotations

from pathlib import Path
from typing import Generic

from benchtool.errors import InputError
from benchtool.web.progress import W


class Latest(Generic[W]):
    """Hold what was started last, by runs folder; a server has one."""

    def __init__(self) -> None:
        self._by_root: dict[Path, W] = {}

    def of(self, root: Path) -> W | None:
        """Return what was started last, None before the first."""
        return self._by_root.get(root)

    def ended(self, root: Path) -> W | None:
        """Return what was started last, so that another can be.

        Raises:
            InputError: it still runs.
        """
        present = self.of(root)
        if present is not None and present.state.running:
            raise InputError(
                f"{present.out.name} still runs ({present.state.what}); wait, or cancel it"
            )
        return present

    def put(self, root: Path, work: W) -> W:
        """Hold what was started now, and return it."""
        self._by_root[root] = work
        return work

    def forget(self, root: Path) -> W | None:
        """Hold nothing any more; return what was held."""
        return self._by_root.pop(root, None)
