"""The seam of the page's tabs: a name, an icon, and the module that builds the tab."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module

from benchtool.web.context import Context


@dataclass(frozen=True, slots=True, kw_only=True)
class Tab:
    """Describe one tab.

    Attributes:
        name: as the page shows it, one word.
        icon: name of a Material icon.
        module: with a function `build(context)` that makes the tab's elements in the present slot,
            for one page. Imported when the tab is first shown, so that a page is usable before
            the libraries of every tab are there.
    """

    name: str
    icon: str
    module: str

    @property
    def key(self) -> str:
        """The tab's name in addresses."""
        return self.name.lower()

    def build(self, context: Context) -> None:
        """Make the tab's elements for one page."""
        import_module(self.module).build(context)
