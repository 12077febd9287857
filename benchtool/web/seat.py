"""One page is at the controls, the others watch. Pure; the time is handed in."""

from __future__ import annotations

GRACE_S = 2.0
"""A controller that is gone for so long may be replaced: reloading a page takes less. A choice."""


class Seat:
    """Remember which page is at the controls.

    Pages are known by a name that a browser's tab keeps when it is loaded again. Stop is not
    asked here: whoever sees the page may stop.
    """

    def __init__(self) -> None:
        self.holder: str | None = None
        self._here: dict[str, int] = {}
        self._gone_s: float | None = None

    def arrive(self, tab: str) -> None:
        """Note that a page is here; the first takes the controls."""
        self._here[tab] = self._here.get(tab, 0) + 1
        if self.holder is None:
            self.holder = tab
        if self.holder == tab:
            self._gone_s = None

    def leave(self, tab: str, now_s: float) -> None:
        """Note that a page is gone. Its controls stay with it until another takes them over."""
        left = self._here.get(tab, 0) - 1
        if left > 0:
            self._here[tab] = left
            return
        self._here.pop(tab, None)
        if self.holder == tab:
            self._gone_s = now_s

    def controls(self, tab: str) -> bool:
        """Tell whether this page is at the controls."""
        return tab != "" and self.holder == tab

    def is_free(self, now_s: float) -> bool:
        """Tell whether another page may take the controls: nobody has them, or they are gone."""
        if self.holder is None:
            return True
        return self._gone_s is not None and now_s - self._gone_s >= GRACE_S

    def take(self, tab: str, now_s: float) -> bool:
        """Take the controls when they are free; tell whether this page has them now."""
        if not self.controls(tab) and tab in self._here and self.is_free(now_s):
            self.holder, self._gone_s = tab, None
        return self.controls(tab)
