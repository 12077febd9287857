"""The seam of the page's tabs: a name, an icon, and what builds the tab when it is first shown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from benchtool.web.context import Context


@dataclass(frozen=True, slots=True, kw_only=True)
class Tab:
    """Describe one tab.

    Attributes:
        name: as the page shows it, one word.
        icon: name of a Material icon.
        build: makes the tab's elements in the present slot, for one page. Called when the tab is
            first shown, so that a page is usable before every tab is made. Heavy imports belong
            inside of it or of its handlers.
    """

    name: str
    icon: str
    build: Callable[[Context], None]

    @property
    def key(self) -> str:
        """The tab's name in addresses."""
        return self.name.lower()
